"""The search for a start, its evaluations answered by hand."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import DDQNHyperparameters, Hyperparameters
from bilevel.nes import NES
from bilevel.tasks import Task
from search_spaces import draw_agent

Score = Callable[[EvaluationRequest], float]


class Answers:
    """Answers every request, in reverse, and keeps the batches."""

    def __init__(self, score: Score, steps: Score = lambda request: 100.0) -> None:
        self.score, self.steps = score, steps
        self.batches: list[list[EvaluationRequest]] = []

    def __call__(self, requests: Sequence[EvaluationRequest]) -> list[EvaluationResult]:
        self.batches.append(list(requests))
        return [
            EvaluationResult((self.score(r),), int(self.steps(r)), 10, True, r.index, 0.01)
            for r in reversed(requests)
        ]


def luck(request: EvaluationRequest) -> float:
    """Anything but a property of the SE."""
    return float(request.seed % 97)


def quality(request: EvaluationRequest) -> float:
    """4 for each good network, of which one in sixteen is."""
    return float(4 ** sum(seed // 16**k % 16 == 0 for k, seed in enumerate(request.start_seeds)))


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


@pytest.mark.parametrize(("candidates", "crossovers"), [(64, 0), (128, 2), (2, 1)])
def test_evaluations_are_as_many_as_announced(
    cartpole: Task, small_hp: Hyperparameters, candidates: int, crossovers: int
) -> None:
    answers = Answers(luck)
    hp = replace(small_hp.nes, start_candidates=candidates, start_crossovers=crossovers)
    search(cartpole, replace(small_hp, nes=hp), answers)
    requests = [request for batch in answers.batches for request in batch]
    assert len(requests) <= hp.start_evaluations
    if candidates > 2:  # of two initialisations there are few crossovers
        assert len(requests) == hp.start_evaluations
    assert len(answers.batches) == 3 * (1 + crossovers)
    assert len({request.seed for request in requests}) == len(requests)


def test_retests_decide(cartpole: Task, small_hp: Hyperparameters) -> None:
    """Of 64 candidates the best 2 are tried again; the one that was merely lucky loses."""
    lucky, good = 5, 11

    def score(request: EvaluationRequest) -> float:
        first = answers.batches[0]
        if len(answers.batches) < 3:
            return {first[lucky].start_seeds: 90.0, first[good].start_seeds: 80.0}.get(
                request.start_seeds, 9.0
            )
        return 20.0 if request.start_seeds == first[lucky].start_seeds else 70.0

    answers = Answers(score)
    psi = search(cartpole, small_hp, answers, start_candidates=64)
    screened, _, retested = answers.batches
    assert {r.start_seeds for r in retested} == {screened[i].start_seeds for i in (lucky, good)}
    expected = NES(cartpole, small_hp, 0).architecture.assembled(screened[good].start_seeds)
    np.testing.assert_array_equal(psi, expected)


def test_who_was_lucky_once_is_not_retested(cartpole: Task, small_hp: Hyperparameters) -> None:
    """8 of 64 candidates are screened again, and the mean of both counts."""

    def score(request: EvaluationRequest) -> float:
        place = [r.start_seeds for r in answers.batches[0]].index(request.start_seeds)
        if len(answers.batches) == 1:
            return 100.0 if place < 6 else 70.0 if place < 8 else 9.0
        return 70.0 if place in (6, 7) else 9.0

    answers = Answers(score)
    search(cartpole, small_hp, answers, start_candidates=64)
    screened, again, retested = answers.batches
    assert {r.start_seeds for r in again} == {r.start_seeds for r in screened[:8]}
    assert {r.start_seeds for r in retested} == {r.start_seeds for r in screened[6:8]}
    assert len({r.seed for r in screened + again}) == 64 + 8


def test_the_start_is_the_fittest(cartpole: Task, small_hp: Hyperparameters) -> None:
    slow = {3: 20_000.0, 8: 1000.0, 9: 2000.0}

    def steps(request: EvaluationRequest) -> float:
        first = [r.start_seeds for r in answers.batches[0]]
        return slow.get(first.index(request.start_seeds), 9000.0)

    answers = Answers(lambda r: 50.0, steps)
    search(cartpole, small_hp, answers, start_candidates=64, step_price=0.1)
    screened, _, retested = answers.batches
    assert {r.start_seeds for r in retested} == {screened[i].start_seeds for i in (8, 9)}


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
    hp = replace(small_hp.nes, start_candidates=64, start_crossovers=1, population_size=32)
    nes = NES(cartpole, replace(small_hp, nes=hp), 0)
    state = nes.start(answers)
    of_start = {
        seed
        for batch in answers.batches
        for r in batch
        for seed in (r.seed, r.perturbation_seed, *r.start_seeds)
    }
    of_generation = {s for r in nes.ask(state) for s in (r.seed, r.perturbation_seed)}
    assert not of_start & of_generation


class TestCrossover:
    def test_networks_of_parents_are_recombined(
        self, cartpole: Task, small_hp: Hyperparameters
    ) -> None:
        answers = Answers(luck)
        search(cartpole, small_hp, answers, start_candidates=128, start_crossovers=1)
        first, _, parents, crossed, *_ = answers.batches
        known = {request.start_seeds[0] for request in parents}
        assert len(known) == 4
        assert all(len(set(request.start_seeds)) == 1 for request in first)
        assert all(set(request.start_seeds) <= known for request in crossed)
        assert len({request.start_seeds for request in crossed}) == len(crossed) == 16

    def test_nothing_is_screened_twice(self, cartpole: Task, small_hp: Hyperparameters) -> None:
        answers = Answers(luck)
        search(cartpole, small_hp, answers, start_candidates=96, start_crossovers=3)
        screened = [r.start_seeds for batch in answers.batches[::3] for r in batch]
        assert len(set(screened)) == len(screened)

    def test_fit_parents_give_more_of_their_networks(
        self, cartpole: Task, small_hp: Hyperparameters
    ) -> None:
        def score(request: EvaluationRequest) -> float:
            if len(answers.batches) > 3:  # the crossovers themselves
                return 0.0
            place = [r.start_seeds for r in answers.batches[0]].index(request.start_seeds)
            return {3: 60.0, 5: 20.0}.get(place, 1.0)

        answers = Answers(score)
        search(cartpole, small_hp, answers, start_candidates=512, start_crossovers=1)
        first, crossed = answers.batches[0], answers.batches[3]
        taken = [seed for request in crossed for seed in request.start_seeds]
        fit, fair, poor = (taken.count(first[i].start_seeds[0]) for i in (3, 5, 0))
        assert fit > 3 * fair > 0
        assert poor <= fair

    def test_it_finds_what_random_search_does_not(
        self, cartpole: Task, small_hp: Hyperparameters
    ) -> None:
        """Where each network is good or bad by itself, as many random candidates end below."""
        crossed: list[float] = []
        alone: list[float] = []
        for seed in range(5):
            for found, candidates, crossovers in ((crossed, 128, 4), (alone, 256, 0)):
                answers = Answers(quality)
                size = {"start_candidates": candidates, "start_crossovers": crossovers}
                search(cartpole, small_hp, answers, seed, **size)
                found.append(max(quality(r) for batch in answers.batches for r in batch))
        assert np.mean(crossed) > 1.3 * np.mean(alone)

    def test_assembled_networks_are_those_of_their_seeds(
        self, cartpole: Task, small_hp: Hyperparameters
    ) -> None:
        shape = NES(cartpole, small_hp, 0).architecture
        mixed = shape.split(shape.assembled((1, 2, 3)))
        for network, seed in enumerate((1, 2, 3)):
            pure = shape.initialize(np.random.default_rng(seed))
            np.testing.assert_array_equal(mixed[network], shape.split(pure)[network])
