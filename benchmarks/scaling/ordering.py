"""What it gains to hand out the requests of a generation in another order."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.scaling.generations import EVALUATIONS_A_MEMBER, MEMBERS, rounded
from benchmarks.scaling.recorded import Evaluations, RecordedRun, VariedGeneration
from benchmarks.scaling.simulation import PoolOverhead, simulate_pool

Order = Callable[[Evaluations, Evaluations], NDArray[np.intp]]


def in_order(now: Evaluations, before: Evaluations) -> NDArray[np.intp]:
    """As the pool does it: psi itself, then psi + eps, then psi - eps."""
    return np.arange(now.seconds.size)


def by_last_generation(now: Evaluations, before: Evaluations) -> NDArray[np.intp]:
    """Longest expected first: what the same request's steps were a generation ago."""
    return np.argsort(-before.train_steps, kind="stable")


def by_last_generations_part(now: Evaluations, before: Evaluations) -> NDArray[np.intp]:
    """The same of the mean steps of psi, psi + eps, psi - eps."""
    parts = before.train_steps.reshape(EVALUATIONS_A_MEMBER, -1).mean(axis=1)
    return np.argsort(-np.repeat(parts, MEMBERS), kind="stable")


def longest_first(now: Evaluations, before: Evaluations) -> NDArray[np.intp]:
    """With the seconds known beforehand: about what the best of forecasts can gain (within
    a third of the best schedule; Graham, 1969)."""
    return np.argsort(-now.seconds, kind="stable")


ORDERS: dict[str, Order] = {
    "last generation, by request": by_last_generation,
    "last generation, mean of psi, +eps, -eps": by_last_generations_part,
    "known beforehand": longest_first,
}


def ordering(
    run: RecordedRun, cores: Sequence[int], overhead: PoolOverhead
) -> list[dict[str, Any]]:
    """Share of the seconds of a run's generations that another order saves."""
    pairs = list(zip(run.generations[1:], run.generations[:-1], strict=True))

    def seconds(order: Order, c: int) -> float:
        return sum(
            simulate_pool(list(now.seconds[order(now, before)]), c, overhead).seconds
            for now, before in pairs
        )

    return [
        {
            "order": name,
            "saved": {str(c): rounded(1 - seconds(o, c) / seconds(in_order, c)) for c in cores},
        }
        for name, o in ORDERS.items()
    ]


def ordering_of_varied(
    varied: Sequence[VariedGeneration], cores: Sequence[int], overhead: PoolOverhead
) -> list[dict[str, Any]]:
    """The same for varied agents, whose sizes are known beforehand."""

    def saved(order: Callable[[VariedGeneration], NDArray[np.float64]], c: int) -> float:
        plain = ordered = 0.0
        for one in varied:
            seconds = one.evaluations.seconds
            first = np.argsort(-order(one), kind="stable")
            plain += simulate_pool(list(seconds), c, overhead).seconds
            ordered += simulate_pool(list(seconds[first]), c, overhead).seconds
        return rounded(1 - ordered / plain)

    return [
        {"order": name, "saved": {str(c): saved(order, c) for c in cores}}
        for name, order in {
            "size of the agent": lambda one: one.work,
            "known beforehand": lambda one: one.evaluations.seconds,
        }.items()
    ]
