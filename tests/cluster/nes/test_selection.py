"""The choice of the best SE, with prescribed scores."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes.halving import Round
from bilevel.synthetic_env import SE, Architecture, SEDistribution, StoredSE, load_se
from bilevel.tasks import Task
from cluster.nes.selection import (
    Contender,
    FinalScore,
    agents_needed,
    choose_best,
    evaluate_holdout,
    export_best,
)
from cluster.ray.pool import EvaluationPool
from tests.conftest import ddqn
from tests.results import made_up_result
from tests.ses import make_se


class ByHand:
    """A pool that returns the k-th outcome (score, train steps) for the SE whose psi is k."""

    def __init__(self, *outcomes: tuple[float, int]) -> None:
        self.outcomes, self.asked = outcomes, list[EvaluationRequest]()

    @property
    def seeds(self) -> list[int]:
        return [request.seed for request in self.asked]

    def run(
        self,
        task: Task,
        se: SE | SEDistribution | None,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> list[EvaluationResult]:
        assert isinstance(se, SE)
        self.asked += requests
        score, steps = self.outcomes[int(se.psi[0])]
        results = [
            made_up_result(request.index, score, train_steps=steps)
            for request in reversed(requests)
        ]
        for result in results:
            on_result(result)
        return results


def contenders(task: Task, hp: Hyperparameters, count: int) -> list[Contender]:
    shape = Architecture.of(task, hp.se)
    ses = [SE(shape, np.full(shape.parameter_count, k, np.float32)) for k in range(count)]
    return [Contender(StoredSE(se, task.id, task.step_limit, task.solved_reward), hp) for se in ses]


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        (((90.0, 1000), (100.0, 9000)), 1),
        (((200.0, 9000), (195.0, 1000)), 0),  # both solve the task
        (((100.0, 9000), (100.0, 1000)), 1),  # equally good in fewer steps
        (((100.0, 1000), (100.0, 1000)), 0),  # equally good: the first one
        (((0.0, 10), (20.0, 1000)), 1),
    ],
)
def test_the_best_is_chosen(
    cartpole: Task,
    small_hp: Hyperparameters,
    outcomes: tuple[tuple[float, int], ...],
    expected: int,
) -> None:
    entered = contenders(cartpole, small_hp, 2)
    pool = cast(EvaluationPool, ByHand(*outcomes))
    assert choose_best(cartpole, entered, (1,), pool) is entered[expected]


def test_an_se_whose_agents_diverge_is_not_chosen(
    cartpole: Task, small_hp: Hyperparameters
) -> None:
    """Even if the worst score of the task is higher than the scores of others."""

    class Diverging(ByHand):
        def run(self, *args: Any) -> list[EvaluationResult]:
            results = super().run(*args)
            return [replace(result, finite=result.score != 0.0) for result in results]

    pool = cast(EvaluationPool, Diverging((-200.0, 1000), (0.0, 10)))
    entered = contenders(cartpole, small_hp, 2)
    assert choose_best(cartpole, entered, (1,), pool) is entered[0]


@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_each_round_keeps_the_best(count: int, cartpole: Task, small_hp: Hyperparameters) -> None:
    """The remaining SEs are tested with more agents, the same for all."""
    by_hand = ByHand(*((100.0 + (3 * k) % 5, 1000) for k in range(count)))
    pool = cast(EvaluationPool, by_hand)
    entered = contenders(cartpole, small_hp, count)
    rounds = (Round(4, 2), Round(2, 3))
    steps: list[int] = []
    best = choose_best(cartpole, entered, (1,), pool, lambda: steps.append(1), rounds)
    # scores 100, 103, 101 and 104; no round includes the SEs after the fourth
    assert best is entered[{1: 0, 2: 1, 3: 1, 9: 3}[count]]
    needed = {1: 0, 2: 2 * 2 + 2 * 3, 3: 3 * 2 + 2 * 3, 9: 4 * 2 + 2 * 3}[count]
    assert len(by_hand.seeds) == len(steps) == agents_needed(count, rounds) == needed
    assert len(set(by_hand.seeds)) == (0 if count == 1 else 5)


def test_only_the_first_round_starts_late(cartpole: Task, small_hp: Hyperparameters) -> None:
    by_hand = ByHand((1.0, 10), (2.0, 10), (3.0, 10))
    entered = contenders(cartpole, small_hp, 3)
    rounds = (Round(3, 2), Round(2, 5))
    pool = cast(EvaluationPool, by_hand)
    best = choose_best(cartpole, entered, (1,), pool, rounds=rounds, is_late=lambda: True)
    assert best is entered[2]
    assert len(by_hand.asked) == 3 * 2


def test_the_final_score_uses_new_seeds(cartpole: Task, small_hp: Hyperparameters) -> None:
    by_hand = ByHand((50.0, 1000), (60.0, 2000))
    pool = cast(EvaluationPool, by_hand)
    best = choose_best(cartpole, contenders(cartpole, small_hp, 2), (1,), pool)
    chosen_by = set(by_hand.seeds)
    by_hand.asked.clear()
    score = evaluate_holdout(cartpole, best, 5, (1,), pool)
    assert (score.scores == 60.0).all()
    assert (score.train_steps == 2000).all()
    assert len(by_hand.seeds) == 5
    assert not chosen_by & set(by_hand.seeds)


def test_the_final_score_uses_the_papers_full_ranges(
    cartpole: Task, small_hp: Hyperparameters
) -> None:
    """And the stopping rule, although NES has patient and small agents."""
    hp = replace(small_hp, vary_agent="small", nes=replace(small_hp.nes, patient_episodes=99))
    (contender,) = contenders(cartpole, hp, 1)
    by_hand = ByHand((60.0, 2000))
    evaluate_holdout(cartpole, contender, 40, (1,), cast(EvaluationPool, by_hand))
    agents = [ddqn(replace(hp, agents=(request.agent,))) for request in by_hand.asked]
    assert {agent.max_episodes for agent in agents} == {ddqn(small_hp).max_episodes}
    assert {agent.early_out_difference for agent in agents} == {0.01}
    assert max(agent.hidden_size for agent in agents) > 300


def test_real_steps_include_all_ends(cartpole: Task, tmp_path: Path) -> None:
    """A resumed run tests its SEs again; writing the same end twice counts once."""
    se = make_se(cartpole)

    def end(step: int, score: float, learned: int, tests: int) -> int:
        scores = FinalScore(np.array([score]), np.array([9]), 195.0)
        path, steps = export_best(se, scores, tmp_path, step, learned, tests)
        assert load_se(path).info["real_env_steps"] == steps
        return steps

    assert end(5, 190.0, learned=1000, tests=10) == 1010
    assert end(5, 190.0, learned=1000, tests=10) == 1010
    assert end(9, 199.0, learned=2000, tests=7) == 2017
    assert end(9, 199.0, learned=2000, tests=7) == 2017
