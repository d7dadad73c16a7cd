from dataclasses import replace
from typing import Any

import numpy as np
import pytest

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
from bilevel.nes.confirmation import Confirming
from bilevel.nes.requests import BRIEF_EPISODES, BRIEF_INIT
from bilevel.nes.start import ChoosingStart
from bilevel.nes.state import Evolving
from bilevel.tasks import Task
from tests.results import made_up_result


def answer(request: EvaluationRequest, score: float, finite: bool = True) -> EvaluationResult:
    return made_up_result(request.index, score, finite=finite)


def answers(nes: NES, state: NESState, score: float) -> list[EvaluationResult]:
    return [answer(request, score) for request in nes.ask(state)]


def after(nes: NES, state: NESState, *scores: float) -> NESState:
    """Return the state after rounds in which all agents have the same score."""
    for score in scores:
        state = nes.tell(state, answers(nes, state, score))
    return state


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

    @pytest.mark.parametrize("shared", [True, False])
    def test_members_may_share_agent_and_random_numbers(
        self, shared: bool, cartpole: Task, small: Hyperparameters
    ) -> None:
        hp = replace(with_nes(small, shared_agent=shared), vary_agent="all")
        nes = NES(cartpole, hp, 0)
        members = nes.ask(nes.init())[2:]
        assert len({request.seed for request in members}) == (1 if shared else 6)
        assert (len({request.agent for request in members}) == 1) is shared
        later = nes.ask(replace(nes.init(), generation=1))[2:]
        assert {r.seed for r in members}.isdisjoint(r.seed for r in later)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"update": "nes", "mirrored_sampling": False}, "needs nes.mirrored_sampling true"),
            ({"update": "antithetic", "mirrored_sampling": False}, "needs nes.mirrored_sampling"),
            (
                {"update": "paper", "score_transform": "rank", "population_size": 1},
                r"'rank' compares members: nes.population_size",
            ),
        ],
    )
    def test_contradictory_hyperparameters(
        self, changes: dict[str, Any], message: str, cartpole: Task, small: Hyperparameters
    ) -> None:
        with pytest.raises(InvalidInput, match=message):
            NES(cartpole, with_nes(small, **changes))


class TestStart:
    def test_agents_train_briefly(self, cartpole: Task, small: Hyperparameters) -> None:
        """Training still lasts longer than the episodes in which agents do not learn."""
        cases = (
            (1, 150, BRIEF_EPISODES),
            (1, 13, 13),
            (BRIEF_EPISODES, 600, BRIEF_INIT * BRIEF_EPISODES),
            (1, 4000, 1000),  # a quarter
            (40, 41, 41),
        )
        for init, longest, expected in cases:
            lengths = {"init_episodes": init, "max_episodes": longest}
            agents = tuple(replace(agent, **lengths) for agent in small.agents)
            nes = NES(cartpole, replace(with_nes(small, start_candidates=3), agents=agents), 1)
            assert {r.agent.max_episodes for r in nes.ask(nes.init())} == {expected}

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
        while isinstance(state.phase, ChoosingStart):
            requests = nes.ask(state)
            sizes.append(len(requests))
            results = []
            for request in requests:
                assert isinstance(request.on, Initialized)
                score = 50.0 if request.on.seed in good else 1.0
                results.append(answer(request, score + (request.on.seed == seeds[9])))
            state = nes.tell(state, results[::-1])
        assert sizes == [40, 5 * 4, 2 * 8]
        expected = nes.family(state.scale).initialize(np.random.default_rng(seeds[9]))
        np.testing.assert_array_equal(state.search.mean, expected)
        assert state.generation == 0
        assert state.real_env_steps == 7 * sum(sizes)

    def test_candidates_that_all_score_the_same_are_replaced(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        """At most 19 times."""
        nes = NES(cartpole, with_nes(small, start_candidates=3), 1)
        state = before = nes.init()
        drawn = set[int]()
        for draws in range(1, 21):
            requests = nes.ask(state)
            assert len(requests) == 3
            assert isinstance(state.phase, ChoosingStart)
            assert state.phase.draws == draws
            drawn |= {r.on.seed for r in requests if isinstance(r.on, Initialized)}
            before, state = state, nes.tell(state, answers(nes, state, 0.0))
        assert len(drawn) == 60
        assert isinstance(state.phase, Evolving)  # equal candidates
        better = [answer(r, 0.5 * r.index) for r in nes.ask(before)]
        assert isinstance(nes.tell(before, better).phase, Evolving)

    def test_a_stagnating_run_restarts(self, cartpole: Task, small: Hyperparameters) -> None:
        nes = NES(cartpole, with_nes(small, restart_after=2, generations=100), 0)
        start = nes.init()
        state = after(nes, start, 20.0, 30.0, 25.0)
        assert state.attempt == 0
        state = after(nes, state, 29.0)
        assert (state.attempt, state.attempt_start, state.generation) == (1, 4, 4)
        assert not np.array_equal(state.search.mean, start.search.mean)
        assert state.finalists[0].generation == 1  # the best of all attempts is kept
        assert after(nes, state, 1.0).records[-1].attempt == 1


class TestTell:
    @pytest.mark.parametrize(
        ("refuted", "finer", "slower"), [(0, 1.0, 1.0), (1, 0.5, 0.5), (4, 1 / 16, 0.25)]
    )
    def test_failed_confirmations_refine_steps_and_average(
        self, refuted: int, finer: float, slower: float, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, averaging=0.5, refinement=0.5, generations=9), 0)
        start = nes.init()
        results = [answer(r, float(r.index % 5)) for r in nes.ask(start)]
        step = nes.tell(start, results).search.mean - start.search.mean
        fine = nes.tell(replace(start, refuted=refuted), results).search
        moved = fine.mean - start.search.mean
        np.testing.assert_allclose(moved, finer * step, rtol=1e-3, atol=1e-6)
        averaged = fine.average - start.search.mean
        np.testing.assert_allclose(averaged, 0.5 * slower * moved, rtol=1e-3, atol=1e-6)

    def test_it_moves_towards_better_members_in_any_order(self, nes: NES) -> None:
        state = nes.init()
        requests = nes.ask(state)
        best = perturbed(requests)[0]
        results = [answer(r, 100.0 * (r.on == best)) for r in requests]
        one, two = nes.tell(state, results), nes.tell(state, results[::-1])
        np.testing.assert_array_equal(one.search.mean, two.search.mean)
        assert (one.search.mean - state.search.mean) @ state.search.noise(best.seed) > 0

    def test_records(self, nes: NES) -> None:
        state = nes.init()
        scores = [10.0, 30.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        requests = nes.ask(state)
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
        later = after(nes, state, 0.0)
        assert later.records[-1].real_env_steps == 2 * 7 * 8
        assert later.cost == pytest.approx(2 * record.cost)

    def test_the_best_ses_are_kept(self, cartpole: Task, small: Hyperparameters) -> None:
        nes = NES(cartpole, with_nes(small, generations=100), 0)
        state, averages = nes.init(), []
        for score in (5.0, 50.0, 20.0, 10.0, 40.0, 30.0):
            averages.append(state.search.average)
            state = after(nes, state, score)
        assert [f.generation for f in state.finalists] == [1, 4, 5, 2]
        expected = nes.distribution(state).at(averages[1]).psi
        np.testing.assert_array_equal(nes.best(state).psi, expected)
        assert [se.info["score_mean"] for se in nes.candidates(state)] == [50.0, 40.0, 30.0, 20.0]
        assert state.best_score == 50.0


class TestEnd:
    def test_solved_for_several_generations_or_out_of_generations(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, solved_for=2, generations=5), 0)
        state, finished = nes.init(), []
        for score in (195.0, 194.9, 195.0, 200.0, 1.0):
            state = after(nes, replace(state, phase=nes.init().phase), score)
            finished.append(state.finished)
            assert not state.confirmed
        assert finished == [False, False, False, True, True]
        endless = NES(cartpole, with_nes(small, solved_for=0, generations=9), 0)
        assert not after(endless, endless.init(), 200.0, 200.0).finished

    def test_generations_count_towards_one_confirmation_only(
        self, cartpole: Task, small: Hyperparameters
    ) -> None:
        nes = NES(cartpole, with_nes(small, solved_for=3, confirming_agents=1, generations=9), 0)
        state, confirmations = nes.init(), []
        for score in (200.0, 190.0, 195.0, 200.0, 200.0, 200.0, 180.0, 200.0):
            state = after(nes, state, score)
            if isinstance(state.phase, Confirming):
                confirmations.append(state.generation)
                state = after(nes, state, 1.0)
        assert confirmations == [3, 6]
        assert state.refuted == 2

    @pytest.mark.parametrize(("score", "confirmed"), [(200.0, True), (190.0, False)])
    def test_fresh_agents_confirm_the_se(
        self, score: float, confirmed: bool, cartpole: Task, small: Hyperparameters
    ) -> None:
        """They are narrowed and never patient. A rejected run continues with narrowed agents."""
        hp = with_nes(small, solved_for=1, confirming_agents=64, patient_episodes=99)
        nes = NES(cartpole, replace(hp, vary_agent="small"), 0)
        state = after(nes, nes.init(), 200.0)
        rounds = []
        while isinstance(state.phase, Confirming):
            requests, before = nes.ask(state), state
            assert {request.on for request in requests} == {Centre()}
            assert {request.agent.early_out_episodes for request in requests} == {10}
            assert {request.agent.max_episodes for request in requests} != {99}
            assert min(vars(r.agent)["hidden_size"] for r in requests) < SIZES[0]  # narrowed
            rounds.append(len(requests))
            state = after(nes, state, score)
            assert state.real_env_steps > before.real_env_steps
            assert state.generation == 1
        assert rounds == ([8, 24, 32] if confirmed else [8])
        assert (state.confirmed, state.finished) == (confirmed, confirmed)
        assert state.refuted == int(not confirmed)
        if confirmed:
            np.testing.assert_array_equal(nes.best(state).psi, nes.current(state).psi)
            assert nes.best(state).info["confirmed"]
        else:
            drawn = [
                [r.agent for r in nes.ask(replace(state, refuted=refuted))] for refuted in (0, 1)
            ]
            assert drawn[0] != drawn[1]


class TestInvalidResults:
    @pytest.mark.parametrize("changes", [{}, {"start_candidates": 9}, {"confirming_agents": 16}])
    def test_missing_and_repeated_results(
        self, changes: dict[str, int], cartpole: Task, small: Hyperparameters
    ) -> None:
        """In a generation, in the choice of a start, and in a confirmation."""
        nes = NES(cartpole, with_nes(small, solved_for=1, **changes), 0)
        state = nes.init()
        if "confirming_agents" in changes:
            state = after(nes, state, 200.0)
        results = answers(nes, state, 20.0)
        for wrong in ([], results[1:], [*results, results[0]], [results[1], *results[1:]]):
            with pytest.raises(InvalidInput, match=f"NES asked for {len(results)} evaluations"):
                nes.tell(state, wrong)
        nes.tell(state, results[::-1])


@pytest.mark.parametrize("seed", [-1, 0.5, "one", None])
def test_invalid_seeds(seed: Any, cartpole: Task, small: Hyperparameters) -> None:
    with pytest.raises(InvalidInput, match="a seed is an integer of at least 0; got"):
        NES(cartpole, small, seed)
