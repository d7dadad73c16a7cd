"""Which SE is handed over, by scores given by hand."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import Hyperparameters
from bilevel.synthetic_env import Architecture, StoredSE
from bilevel.tasks import Task
from cluster.final import Contender, Round, agents_needed, choose_best, score_anew
from cluster.pool import EvaluationPool


class ByHand:
    """Stands for a pool: score and train steps of the SE whose parameters are all k."""

    def __init__(self, *outcomes: tuple[float, int]) -> None:
        self.outcomes, self.seeds = outcomes, list[int]()

    def run(
        self,
        task: Task,
        architecture: Architecture,
        psi: NDArray[np.float32],
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None],
    ) -> list[EvaluationResult]:
        self.seeds += [request.seed for request in requests]
        score, steps = self.outcomes[int(psi[0])]
        results = [
            EvaluationResult((score,), steps, 10, np.isfinite(score), request.index, 0.01)
            for request in reversed(requests)
        ]
        for result in results:
            on_result(result)
        return results


def contenders(task: Task, hp: Hyperparameters, count: int, price: float) -> list[Contender]:
    shape = Architecture.of(task, hp.se)
    hp = replace(hp, nes=replace(hp.nes, step_price=price))
    psis = [np.full(shape.parameter_count, k, np.float32) for k in range(count)]
    return [
        Contender(StoredSE(shape, psi, task.id, task.step_limit, task.solved_reward), hp)
        for psi in psis
    ]


@pytest.mark.parametrize(
    ("outcomes", "price", "expected"),
    [
        (((90.0, 1000), (100.0, 9000)), 0.0, 1),
        (((90.0, 1000), (100.0, 9000)), 0.02, 1),
        (((195.0, 1000), (200.0, 9000)), 0.02, 0),  # 191.1 and 164
        (((194.0, 1000), (200.0, 9000)), 0.02, 1),  # the first does not solve the task
        (((100.0, 9000), (100.0, 1000)), 0.0, 1),
        (((np.nan, 10), (20.0, 1000)), 0.0, 1),
    ],
)
def test_the_best_is_chosen(
    cartpole: Task,
    small_hp: Hyperparameters,
    outcomes: tuple[tuple[float, int], ...],
    price: float,
    expected: int,
) -> None:
    entered = contenders(cartpole, small_hp, 2, price)
    pool = cast(EvaluationPool, ByHand(*outcomes))
    assert choose_best(cartpole, entered, (1,), pool) is entered[expected]


@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_each_round_keeps_the_best(count: int, cartpole: Task, small_hp: Hyperparameters) -> None:
    """Who is left is tried on more agents, all on the same."""
    by_hand = ByHand(*((100.0 + (3 * k) % 5, 1000) for k in range(count)))
    pool = cast(EvaluationPool, by_hand)
    entered = contenders(cartpole, small_hp, count, 0.0)
    rounds = (Round(4, 2), Round(2, 5))
    steps: list[int] = []
    best = choose_best(cartpole, entered, (1,), pool, lambda: steps.append(1), rounds)
    # 100, 103, 101 and 104; those behind the fourth are in no round
    assert best is entered[{1: 0, 2: 1, 3: 1, 9: 3}[count]]
    told = {1: 0, 2: 2 * 2 + 2 * 3, 3: 3 * 2 + 2 * 3, 9: 4 * 2 + 2 * 3}[count]
    assert len(by_hand.seeds) == len(steps) == agents_needed(count, rounds) == told
    assert len(set(by_hand.seeds)) == (0 if count == 1 else 5)


@pytest.mark.parametrize(("later", "expected"), [(10.0, 1), (95.0, 0)])
def test_a_score_that_was_lucky_is_found_out(
    cartpole: Task, small_hp: Hyperparameters, later: float, expected: int
) -> None:
    """More agents count, and beside them the first ones: two score 120, six `later`."""

    class Lucky(ByHand):
        def run(self, task, architecture, psi, requests, on_result):  # type: ignore[no-untyped-def]
            results = super().run(task, architecture, psi, requests, on_result)
            fell = psi[0] == 0 and len(requests) == 6
            return [replace(r, test_returns=(later,)) if fell else r for r in results]

    pool = cast(EvaluationPool, Lucky((120.0, 1000), (100.0, 1000)))
    entered = contenders(cartpole, small_hp, 2, 0.0)
    rounds = (Round(2, 2), Round(2, 8))
    assert choose_best(cartpole, entered, (1,), pool, rounds=rounds[:1]) is entered[0]
    assert choose_best(cartpole, entered, (1,), pool, rounds=rounds) is entered[expected]


def test_the_final_score_has_seeds_of_its_own(cartpole: Task, small_hp: Hyperparameters) -> None:
    by_hand = ByHand((50.0, 1000), (60.0, 2000))
    pool = cast(EvaluationPool, by_hand)
    best = choose_best(cartpole, contenders(cartpole, small_hp, 2, 0.0), (1,), pool)
    chosen_by = set(by_hand.seeds)
    by_hand.seeds.clear()
    score = score_anew(cartpole, best, 5, (1,), pool)
    assert (score.scores == 60.0).all()
    assert (score.train_steps == 2000).all()
    assert len(by_hand.seeds) == 5
    assert not chosen_by & set(by_hand.seeds)
