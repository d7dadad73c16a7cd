from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bilevel.agents.training import returns_converged
from bilevel.agents.variation import SIZES
from bilevel.errors import InvalidInput
from bilevel.evaluation import (
    Centre,
    EvaluationRequest,
    EvaluationResult,
    Initialized,
    Perturbed,
)
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES, NESState
from bilevel.nes.checkpoint import save_state
from bilevel.nes.requests import as_turn
from bilevel.nes.start import EPISODES
from bilevel.synthetic_env import load_se, save_se
from bilevel.tasks import Task
from tests.results import made_up_result


def answer(request: EvaluationRequest, score: float, finite: bool = True) -> EvaluationResult:
    return made_up_result(request.index, score, finite=finite)


def answers(nes: NES, state: NESState, score: float) -> list[EvaluationResult]:
    return [answer(request, score) for request in nes.ask(state)]


def with_nes(hp: Hyperparameters, **changes: object) -> Hyperparameters:
    return replace(hp, nes=replace(hp.nes, **changes))  # type: ignore[arg-type]


@pytest.fixture
def small(small_hp: Hyperparameters) -> Hyperparameters:
    return with_nes(small_hp, centre_agents=2)


@pytest.fixture
def nes(cartpole: Task, small: Hyperparameters) -> NES:
    return NES(cartpole, small, seed=4)


def perturbed(requests: list[EvaluationRequest]) -> list[Perturbed]:
    return [request.on for request in requests if isinstance(request.on, Perturbed)]


class TestAsk:
    def test_centre_plus_and_minus(self, nes: NES) -> None:
        requests = nes.ask(nes.init())
        assert [request.index for request in requests] == list(range(8))
        assert [request.on for request in requests[:2]] == [Centre(), Centre()]
        members = perturbed(requests)
        assert [on.sign for on in members] == [1] * 3 + [-1] * 3
        assert [on.seed for on in members[:3]] == [on.seed for on in members[3:]]
        assert len({on.seed for on in members}) == 3
        assert len(requests) == nes.hp.nes.evaluations

    def test_without_mirrored_sampling(self, cartpole: Task, small: Hyperparameters) -> None:
        nes = NES(cartpole, with_nes(small, update="paper", mirrored_sampling=False), 0)
        assert [on.sign for on in perturbed(nes.ask(nes.init()))] == [1] * 3
        assert nes.hp.nes.evaluations == 5

    @pytest.mark.parametrize("shared", [True, False])
    def test_members_share_agent_and_random_numbers_if_asked_to(
        self, shared: bool, cartpole: Task, small: Hyperparameters
    ) -> None:
        hp = replace(with_nes(small, shared_agent=shared), vary_agent="all")
        nes = NES(cartpole, hp, 0)
        members = nes.ask(nes.init())[2:]
        assert len({request.seed for request in members}) == (1 if shared else 6)
        assert (len({request.agent for request in members}) == 1) is shared
        later = nes.ask(replace(nes.init(), generation=1))[2:]
        assert {r.seed for r in members}.isdisjoint(r.seed for r in later)

    def test_the_same_seed_asks_the_same(self, nes: NES) -> None:
        assert nes.ask(nes.init()) == nes.ask(nes.init())
        other = replace(nes, seed=5)
        seeds = {request.seed for request in nes.ask(nes.init())}
        assert seeds.isdisjoint(request.seed for request in other.ask(other.init()))

    def test_every_second_turn_is_patient(self, cartpole: Task, small: Hyperparameters) -> None:
        nes = NES(cartpole, with_nes(small, patient_episodes=5), 0)
        for generation, patient in ((0, False), (1, True)):
            requests = nes.ask(replace(nes.init(), generation=generation))
            trained = [(r.agent.max_episodes, r.agent.early_out_episodes) for r in requests]
            usual = (13, small.agents[0].early_out_episodes)
            assert trained[:2] == [usual, (5, 5)]
            assert set(trained[2:]) == {(5, 5) if patient else usual}

    def test_a_transform_that_compares_needs_members(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        one = replace(small.nes, update="snes", score_transform="rank", population_size=1)
        NES(cartpole, replace(small, nes=one))
        with pytest.raises(InvalidInput, match=r"'rank' compares members: nes.population_size"):
            NES(cartpole, replace(small, nes=replace(one, update="paper")))

    def test_a_rule_that_needs_pairs_says_so(self, cartpole: Task, small: Hyperparameters) -> None:
        for update in ("snes", "antithetic"):
            hp = with_nes(small, update=update, mirrored_sampling=False)
            with pytest.raises(InvalidInput, match=r"needs nes.mirrored_sampling true"):
                NES(cartpole, hp)


class TestStart:
    def test_agents_that_choose_train_briefly(self, cartpole: Task, small: Hyperparameters) -> None:
        """But always beyond the episodes in which they do not learn."""
        cases = ((1, 150, EPISODES), (1, 13, 13), (EPISODES, 150, 2 * EPISODES), (40, 41, 41))
        for init, longest, expected in cases:
            lengths = {"init_episodes": init, "max_episodes": longest}
            agents = tuple(replace(agent, **lengths) for agent in small.agents)
            nes = NES(cartpole, replace(with_nes(small, start_candidates=3), agents=agents), 1)
            trained = {request.agent.max_episodes for request in nes.ask(nes.init())}
            assert trained == {expected}

    def test_the_best_candidate_of_the_last_round_is_the_start(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, start_candidates=40), 1)
        state = nes.init()
        first = nes.ask(state)
        seeds = [request.on.seed for request in first if isinstance(request.on, Initialized)]
        assert len(set(seeds)) == 40
        assert len({request.seed for request in first}) == 1  # common random numbers
        good = set(seeds[7:12])
        sizes = []
        while state.race is not None:
            requests = nes.ask(state)
            sizes.append(len(requests))
            results = []
            for request in requests:
                assert isinstance(request.on, Initialized)
                score = 50.0 if request.on.seed in good else 1.0
                results.append(answer(request, score + (request.on.seed == seeds[9])))
            state = nes.tell(state, results[::-1])
        assert sizes == [40, 5 * 4, 2 * 8]
        expected = state.se.coordinates.initialize(np.random.default_rng(seeds[9]))
        np.testing.assert_array_equal(state.se.mean, expected)
        assert state.generation == 0
        assert state.real_env_steps == 7 * sum(sizes)

    def test_a_single_candidate_is_tried_by_nobody(self, nes: NES) -> None:
        assert nes.init().race is None

    def test_a_run_that_does_not_get_going_begins_again(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, restart_after=2, generations=100), 0)
        state = nes.init()
        began = state.se.mean
        for score in (20.0, 30.0, 25.0):
            state = nes.tell(state, answers(nes, state, score))
            assert state.attempt == 0
        state = nes.tell(state, answers(nes, state, 29.0))
        assert (state.attempt, state.attempt_began, state.generation) == (1, 4, 4)
        assert not np.array_equal(state.se.mean, began)
        assert state.finalists[0].generation == 1  # the best of all attempts is kept
        state = nes.tell(state, answers(nes, state, 1.0))
        assert state.records[-1].attempt == 1

    def test_a_run_that_has_solved_the_task_does_not(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, restart_after=1, generations=100), 0)
        state = nes.init()
        for score in (196.0, 50.0, 50.0, 50.0):
            state = nes.tell(state, answers(nes, state, score))
        assert state.attempt == 0


class TestTell:
    @pytest.mark.parametrize("kept", [0.0, 0.75])
    def test_the_unperturbed_se_is_a_moving_average(
        self, kept: float, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, averaging=kept, generations=9), 0)
        state = nes.init()
        np.testing.assert_array_equal(state.se.average, state.se.mean)
        expected = state.se.mean
        for _ in range(3):
            results = [answer(r, float(r.index % 5)) for r in nes.ask(state)]
            tried, state = state.se.average, nes.tell(state, results)
            assert any(np.array_equal(f.theta, tried) for f in state.finalists)
            expected = kept * expected + (1 - kept) * state.se.mean
            np.testing.assert_allclose(state.se.average, expected, rtol=1e-5, atol=1e-6)
            np.testing.assert_array_equal(state.se.centre.psi, state.se.at(state.se.average).psi)
        apart = float(np.abs(state.se.mean - state.se.average).max())
        assert (apart > 1e-4) is bool(kept)

    @pytest.mark.parametrize(
        ("refuted", "finer", "slower"), [(0, 1.0, 1.0), (1, 0.5, 0.5), (4, 1 / 16, 0.25)]
    )
    def test_failed_confirmations_refine_steps_and_average(
        self, refuted: int, finer: float, slower: float, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, averaging=0.5, refinement=0.5, generations=9), 0)
        began = nes.init()
        results = [answer(r, float(r.index % 5)) for r in nes.ask(began)]
        usual = nes.tell(began, results).se
        fine = nes.tell(replace(began, refuted=refuted), results).se
        step = usual.mean - began.se.mean
        np.testing.assert_allclose(fine.mean - began.se.mean, finer * step, rtol=1e-3, atol=1e-6)
        moved = 0.5 * slower * (fine.mean - began.se.mean)
        np.testing.assert_allclose(fine.average - began.se.mean, moved, rtol=1e-3, atol=1e-6)

    def test_it_moves_towards_better_members_whatever_their_order(self, nes: NES) -> None:
        state = nes.init()
        requests = nes.ask(state)
        target = state.se.noise(perturbed(requests)[0].seed)
        results = [
            answer(r, 100.0 * (isinstance(r.on, Perturbed) and r.on == perturbed(requests)[0]))
            for r in requests
        ]
        one, two = nes.tell(state, results), nes.tell(state, results[::-1])
        np.testing.assert_array_equal(one.se.mean, two.se.mean)
        assert (one.se.mean - state.se.mean) @ target > 0

    def test_what_is_recorded(self, nes: NES) -> None:
        state = nes.init()
        requests = nes.ask(state)
        scores = [10.0, 30.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        results = [answer(r, s, finite=s != 1.0) for r, s in zip(requests, scores, strict=True)]
        state = nes.tell(state, results).timed(2.0, 2, 99.0)
        record = state.records[-1]
        assert (record.score_mean, record.score_std, record.score_best) == (20.0, 10.0, 30.0)
        assert record.perturbed_score_mean == 3.5
        assert (record.train_steps_mean, record.train_episodes_mean) == (100.0, 10.0)
        assert (record.non_finite, record.solved_fraction) == (1, 0.0)
        assert record.real_env_steps == 7 * 8
        assert record.cost == pytest.approx(sum(result.cost for result in results))
        assert record.core_utilisation == pytest.approx(8 * 0.01 / 4)
        assert (record.generation_seconds, record.finished) == (2.0, 99.0)
        later = nes.tell(state, answers(nes, state, 0.0))
        assert later.records[-1].real_env_steps == 2 * 7 * 8
        assert later.cost == pytest.approx(2 * record.cost)
        assert record.cost > 0

    def test_the_best_ses_are_kept(self, cartpole: Task, small: Hyperparameters) -> None:
        nes = NES(cartpole, with_nes(small, generations=100), 0)
        state, thetas = nes.init(), []
        for score in (5.0, 50.0, 20.0, 10.0, 40.0, 30.0):
            thetas.append(state.se.average)
            state = nes.tell(state, answers(nes, state, score))
        assert [f.generation for f in state.finalists] == [1, 4, 5, 2]
        np.testing.assert_array_equal(state.best.psi, state.se.at(thetas[1]).psi)
        assert state.best_score == 50.0

    def test_it_is_finished_once_solved_for_long_enough_or_out_of_generations(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, solved_for=2, generations=5), 0)
        state, finished = nes.init(), []
        for score in (195.0, 194.9, 195.0, 200.0, 1.0):
            state = nes.tell(state, answers(nes, state, score))
            finished.append(state.finished)
            assert not state.confirmed  # without fresh agents nobody has confirmed it
        assert finished == [False, False, False, True, True]

    def test_a_confirmation_that_failed_waits_for_generations_of_its_own(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        """The mean over generations counts, of those that no confirmation has judged."""
        nes = NES(cartpole, with_nes(small, solved_for=3, confirming_agents=1, generations=9), 0)
        state, tried = nes.init(), []
        for score in (200.0, 190.0, 195.0, 200.0, 200.0, 200.0, 180.0, 200.0):
            state = nes.tell(state, answers(nes, state, score))
            if state.confirmation is not None:
                tried.append(state.generation)
                state = nes.tell(state, answers(nes, state, 1.0))
        assert tried == [3, 6]
        assert state.refuted == 2

    @pytest.mark.parametrize(("confirming", "ends"), [(200.0, True), (190.0, False)])
    def test_fresh_agents_confirm_it(
        self, confirming: float, ends: bool, cartpole: Task, small: Hyperparameters
    ) -> None:
        """They are narrowed and never patient; a run that they do not confirm continues, with
        narrowed agents."""
        hp = with_nes(small, solved_for=1, confirming_agents=64, patient_episodes=99)
        nes = NES(cartpole, replace(hp, vary_agent="small"), 0)
        state = nes.init()
        while not state.records:
            state = nes.tell(state, answers(nes, state, 200.0))
        rounds = []
        while state.confirmation is not None:
            assert not state.finished
            requests, before = nes.ask(state), state
            assert {request.on for request in requests} == {Centre()}
            assert {request.agent.early_out_episodes for request in requests} == {10}
            assert {request.agent.max_episodes for request in requests} != {99}
            assert min(vars(r.agent)["hidden_size"] for r in requests) < SIZES[0]  # narrowed
            rounds.append(len(requests))
            state = nes.tell(state, answers(nes, state, confirming))
            assert state.real_env_steps > before.real_env_steps
            assert state.generation == 1
        assert rounds == ([8, 24, 32] if ends else [8])
        assert (state.confirmed, state.finished, state.refuted) == (ends, ends, int(not ends))
        if not ends:
            small_ones, others = (
                [request.agent for request in nes.ask(replace(state, refuted=refuted))]
                for refuted in (0, 1)
            )
            assert small_ones != others

    def test_out_of_generations_it_is_still_confirmed(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, solved_for=1, confirming_agents=1, generations=1), 0)
        state = nes.tell(nes.init(), answers(nes, nes.init(), 200.0))
        assert not state.finished
        state = nes.tell(state, answers(nes, state, 3.0))
        assert (state.confirmed, state.finished) == (False, True)

    def test_without_a_streak_to_reach_it_goes_on(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, solved_for=0, generations=9), 0)
        state = nes.tell(nes.init(), answers(nes, nes.init(), 200.0))
        assert not state.finished


def test_a_run_that_is_extended_begins_again_where_an_undisturbed_one_does(
    cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    """A restart that is due at the last generation waits until there are more generations: the SE
    of a finished run is one that it has learned."""
    short, long = (
        NES(cartpole, with_nes(small_hp, restart_after=2, generations=generations), 0)
        for generations in (3, 9)
    )
    ends = []
    for nes in (short, long):
        state = nes.init()
        for _ in range(3):
            state = nes.tell(state, answers(nes, state, 5.0))
        ends.append(state)
    assert [end.finished for end in ends] == [True, False]
    assert [end.attempt for end in ends] == [0, 1]
    save_state(ends[0], tmp_path / "state")
    assert short.load(tmp_path / "state").attempt == 0
    extended = long.load(tmp_path / "state")
    assert (extended.attempt, extended.attempt_began, extended.finished) == (1, 3, False)
    np.testing.assert_array_equal(extended.se.mean, ends[1].se.mean)


class TestResultsThatDoNotBelong:
    @pytest.mark.parametrize("candidates", [1, 9])
    def test_a_result_missing_or_told_twice_is_refused(
        self, candidates: int, cartpole: Task, small: Hyperparameters
    ) -> None:
        """In a generation, and in the choice of a start."""
        nes = NES(cartpole, with_nes(small, start_candidates=candidates), 0)
        state = nes.init()
        results = answers(nes, state, 20.0)
        for wrong in ([], results[1:], [*results, results[0]], [results[1], *results[1:]]):
            with pytest.raises(InvalidInput, match=f"NES asked for {len(results)} evaluations"):
                nes.tell(state, wrong)
        nes.tell(state, results[::-1])

    @pytest.mark.parametrize("returns", [(), (float("nan"),), (200.0, float("inf"))])
    def test_returns_that_are_no_numbers_are_refused(
        self, returns: tuple[float, ...], cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, small, 0)
        state = nes.init()
        first, *others = answers(nes, state, 20.0)
        with pytest.raises(InvalidInput, match="the result of request 0 has the test returns"):
            nes.tell(state, [replace(first, test_returns=returns), *others])

    def test_also_in_a_confirmation(self, cartpole: Task, small: Hyperparameters) -> None:
        nes = NES(cartpole, with_nes(small, solved_for=1, confirming_agents=16), 0)
        state = nes.tell(nes.init(), answers(nes, nes.init(), 200.0))
        assert state.confirmation is not None
        results = answers(nes, state, 200.0)
        with pytest.raises(InvalidInput, match="NES asked for 2 evaluations"):
            nes.tell(state, results[:1])


@pytest.mark.parametrize("seed", [-1, 0.5, "one", None])
def test_a_seed_is_a_whole_number(seed: Any, cartpole: Task, small: Hyperparameters) -> None:
    with pytest.raises(InvalidInput, match="a seed is an integer of at least 0; got"):
        NES(cartpole, small, seed)


def test_a_seed_of_numpys_is_as_good(
    cartpole: Task, small: Hyperparameters, tmp_path: Path
) -> None:
    nes = NES(cartpole, small, np.arange(5)[4])
    assert nes == NES(cartpole, small, 4)
    save_se(nes.init().best, tmp_path / "se")
    assert load_se(tmp_path / "se").info["seed"] == 4


def test_patient_agents_do_not_stop_early(cartpole: Task, small: Hyperparameters) -> None:
    """Not even where all returns are equal, as on an SE whose rewards are all the same."""
    patient = replace(small.nes, patient_episodes=30)
    assert as_turn(small.agents[0], patient, turn=1).max_episodes == 13  # of at most 13
    agent = as_turn(replace(small.agents[0], max_episodes=99), patient, turn=1)
    stop = returns_converged(agent)
    assert agent.max_episodes == 30
    assert not any(stop([1.0] * episodes) for episodes in range(1, 31))
    assert as_turn(small.agents[0], small.nes, turn=1) == small.agents[0]
