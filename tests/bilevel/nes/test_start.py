"""The search for a start, its evaluations answered by hand."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import DDQNHyperparameters, Hyperparameters
from bilevel.hyperparameters.definitions import FIT_TESTS
from bilevel.nes import NES, Psi
from bilevel.synthetic_env import fitted
from bilevel.synthetic_env.fitted import action_values
from bilevel.tasks import Task
from search_spaces import draw_agent

Score = Callable[[EvaluationRequest], float]


class Answers:
    """Answers every request, in reverse, and keeps the batches."""

    def __init__(self, score: Score, steps: Score = lambda request: 100.0) -> None:
        self.score, self.steps = score, steps
        self.psis: list[Psi | None] = []
        self.batches: list[list[EvaluationRequest]] = []

    def __call__(
        self, psi: Psi | None, requests: Sequence[EvaluationRequest]
    ) -> list[EvaluationResult]:
        self.psis.append(psi)
        self.batches.append(list(requests))
        return [
            EvaluationResult((self.score(r),), int(self.steps(r)), 10, True, r.index, 0.01)
            for r in reversed(requests)
        ]


def luck(request: EvaluationRequest) -> float:
    """Anything but a property of the SE."""
    return float(request.seed % 97)


def search(
    task: Task, hp: Hyperparameters, answers: Answers, seed: int = 0, **nes: Any
) -> np.ndarray:
    """The start that is found."""
    hp = replace(hp, nes=replace(hp.nes, **nes))
    return NES(task, hp, seed, draw_agent).start(answers).psi


def test_a_single_candidate_needs_no_evaluation(cartpole: Task, small_hp: Hyperparameters) -> None:
    nes = NES(cartpole, small_hp, 4)
    assert nes.hp.nes.start_evaluations == 0
    np.testing.assert_array_equal(nes.start().psi, nes.start().psi)


@pytest.mark.parametrize("candidates", [2, 64, 100])
def test_evaluations_are_as_many_as_announced(
    cartpole: Task, small_hp: Hyperparameters, candidates: int
) -> None:
    answers = Answers(luck)
    hp = replace(small_hp.nes, start_candidates=candidates)
    search(cartpole, replace(small_hp, nes=hp), answers)
    requests = [request for batch in answers.batches for request in batch]
    assert len(requests) == hp.start_evaluations
    assert len({request.seed for request in requests}) == len(requests)


def test_retests_decide(cartpole: Task, small_hp: Hyperparameters) -> None:
    """Of 64 candidates the best 2 are tried again; the one that was merely lucky loses."""
    lucky, good = 5, 11

    def score(request: EvaluationRequest) -> float:
        first = answers.batches[0]
        if len(answers.batches) < 3:
            return {first[lucky].start_seed: 90.0, first[good].start_seed: 80.0}.get(
                request.start_seed, 9.0
            )
        return 20.0 if request.start_seed == first[lucky].start_seed else 70.0

    answers = Answers(score)
    psi = search(cartpole, small_hp, answers, start_candidates=64)
    screened, _, retested = answers.batches
    assert {r.start_seed for r in retested} == {screened[i].start_seed for i in (lucky, good)}
    seed = screened[good].start_seed
    expected = NES(cartpole, small_hp, 0).architecture.initialize(np.random.default_rng(seed))
    np.testing.assert_array_equal(psi, expected)


def test_who_was_lucky_once_is_not_retested(cartpole: Task, small_hp: Hyperparameters) -> None:
    """8 of 64 candidates are screened again, and the mean of both counts."""

    def score(request: EvaluationRequest) -> float:
        place = [r.start_seed for r in answers.batches[0]].index(request.start_seed)
        if len(answers.batches) == 1:
            return 100.0 if place < 6 else 70.0 if place < 8 else 9.0
        return 70.0 if place in (6, 7) else 9.0

    answers = Answers(score)
    search(cartpole, small_hp, answers, start_candidates=64)
    screened, again, retested = answers.batches
    assert {r.start_seed for r in again} == {r.start_seed for r in screened[:8]}
    assert {r.start_seed for r in retested} == {r.start_seed for r in screened[6:8]}
    assert len({r.seed for r in screened + again}) == 64 + 8


def test_the_start_is_the_fittest(cartpole: Task, small_hp: Hyperparameters) -> None:
    slow = {3: 20_000.0, 8: 1000.0, 9: 2000.0}

    def steps(request: EvaluationRequest) -> float:
        first = [r.start_seed for r in answers.batches[0]]
        return slow.get(first.index(request.start_seed), 9000.0)

    answers = Answers(lambda r: 50.0, steps)
    search(cartpole, small_hp, answers, start_candidates=64, step_price=0.1)
    screened, _, retested = answers.batches
    assert {r.start_seed for r in retested} == {screened[i].start_seed for i in (8, 9)}


def test_screening_is_short_and_retests_are_fair(
    cartpole: Task, small_hp: Hyperparameters, small_agent: DDQNHyperparameters
) -> None:
    agent = replace(small_agent, init_episodes=4, early_out_episodes=10, max_episodes=1000)
    hp = replace(small_hp, agents=(agent,), vary_agent="all")
    answers = Answers(luck)
    search(cartpole, hp, answers, start_candidates=40, max_episodes=200)
    screened, _, retested = answers.batches
    assert {r.agent.max_episodes for r in screened} == {34}
    assert len({vars(r.agent)["learning_rate"] for r in screened}) == 40
    assert {r.agent.max_episodes for r in retested} == {200}
    assert [r.agent for r in retested[:8]] == [r.agent for r in retested[8:]]


def test_every_second_retest_is_of_a_neighbour(cartpole: Task, small_hp: Hyperparameters) -> None:
    answers = Answers(luck)
    search(cartpole, small_hp, answers, start_candidates=64)
    screened, _, retested = answers.batches
    assert {(r.sign, r.std_dev) for r in screened} == {(0, 0.0)}
    assert [r.sign for r in retested] == [0, 1] * 8
    assert {r.std_dev for r in retested} == {small_hp.nes.std_dev}
    assert len({r.perturbation_seed for r in retested}) == len(retested)


def test_the_start_shares_no_seed_with_the_generations(
    cartpole: Task, small_hp: Hyperparameters
) -> None:
    answers = Answers(luck)
    hp = replace(small_hp.nes, start_candidates=64, population_size=32)
    nes = NES(cartpole, replace(small_hp, nes=hp), 0)
    state = nes.start(answers)
    of_start = {
        seed
        for batch in answers.batches
        for r in batch
        for seed in (r.seed, r.perturbation_seed, r.start_seed)
    }
    of_generation = {s for r in nes.ask(state) for s in (r.seed, r.perturbation_seed)}
    assert not of_start & of_generation


class TestFitted:
    @pytest.fixture
    def fits(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Fits of a moment, which tell nothing but that they differ."""
        monkeypatch.setattr(fitted, "RANDOM_STEPS", 32)
        monkeypatch.setattr(fitted, "POLICY_STEPS", 32)
        monkeypatch.setattr(action_values, "SNAPSHOTS", 1)
        monkeypatch.setattr(action_values, "SNAPSHOT_STEPS", 1)
        monkeypatch.setattr(fitted, "FIT_STEPS", 1)

    @pytest.mark.usefixtures("fits")
    def test_a_single_one_needs_no_evaluation(
        self, cartpole: Task, small_hp: Hyperparameters
    ) -> None:
        hp = replace(small_hp, nes=replace(small_hp.nes, start="fitted"))
        assert hp.nes.start_evaluations == 0
        first, other = (NES(cartpole, hp, seed).start().psi for seed in (0, 1))
        np.testing.assert_array_equal(first, NES(cartpole, hp, 0).start().psi)
        assert not np.array_equal(first, other)

    def test_others_may_make_the_fits(self, cartpole: Task, small_hp: Hyperparameters) -> None:
        """By the same seeds; a single one is made here."""
        asked: list[int] = []

        def fits(seeds: Sequence[int]) -> list[Psi]:
            asked.extend(seeds)
            return [np.full(3, number, np.float32) for number, _ in enumerate(seeds)]

        answers = Answers(lambda request: 50.0 if len(answers.batches) == 2 else 9.0)
        nes = replace(small_hp.nes, start="fitted", start_candidates=3)
        run = NES(cartpole, replace(small_hp, nes=nes), 0, draw_agent)
        np.testing.assert_array_equal(run.start(answers, fits).psi, [1, 1, 1])
        assert asked == run.start_search.fit_seeds
        assert len(set(asked)) == 3

    @pytest.mark.usefixtures("fits")
    def test_the_best_is_the_start(self, cartpole: Task, small_hp: Hyperparameters) -> None:
        """Each is tried by the same agents with the same seeds."""
        answers = Answers(lambda request: 50.0 if len(answers.batches) == 2 else 9.0)
        psi = search(cartpole, small_hp, answers, start="fitted", start_candidates=3)
        assert len(answers.batches) == 3
        assert answers.batches[0] == answers.batches[1] == answers.batches[2]
        assert {r.sign for r in answers.batches[0]} == {0}
        np.testing.assert_array_equal(psi, answers.psis[1])

    @pytest.mark.parametrize(
        ("outcomes", "best"),
        [
            (((190.0, 1000.0), (196.0, 9000.0)), 1),  # the first is fitter, but does not solve
            (((200.0, 5000.0), (196.0, 3000.0)), 1),  # 180 and 184.24
            (((150.0, 1000.0), (160.0, 9000.0)), 1),
        ],
    )
    @pytest.mark.usefixtures("fits")
    def test_steps_count_among_those_that_solve(
        self,
        cartpole: Task,
        small_hp: Hyperparameters,
        outcomes: tuple[tuple[float, float], ...],
        best: int,
    ) -> None:
        answers = Answers(
            lambda request: outcomes[len(answers.batches) - 1][0],
            lambda request: outcomes[len(answers.batches) - 1][1],
        )
        psi = search(
            cartpole, small_hp, answers, start="fitted", start_candidates=2, step_price=0.02
        )
        np.testing.assert_array_equal(psi, answers.psis[best])

    @pytest.mark.usefixtures("fits")
    def test_evaluations_are_as_many_as_announced(
        self, cartpole: Task, small_hp: Hyperparameters
    ) -> None:
        answers = Answers(luck)
        hp = replace(small_hp.nes, start="fitted", start_candidates=3)
        search(cartpole, replace(small_hp, nes=hp), answers)
        assert sum(map(len, answers.batches)) == hp.start_evaluations == 3 * FIT_TESTS
