"""What to do with cores that a generation of 16 leaves idle: never wait, or more members."""

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.scaling.generations import (
    CORES,
    DRAWS,
    EVALUATIONS_A_MEMBER,
    GENERATION,
    MEMBERS,
    rounded,
)
from benchmarks.scaling.recorded import Evaluations
from benchmarks.scaling.simulation import PoolOverhead, simulate_pool

#: A larger population may take this much longer than the paper's.
SLACK = 1.1


def asynchronous(
    generations: Sequence[Evaluations],
    between: float,
    cores: Sequence[int],
    overhead: PoolOverhead,
) -> list[dict[str, float]]:
    """How many times as many generations an NES that never waits would make at most: the
    same evaluations on cores that are always busy, no more of them than a generation has
    evaluations."""
    rows = []
    for c in cores:
        lines = [simulate_pool(list(g.seconds), c, overhead) for g in generations]
        waiting = sum(line.seconds + between for line in lines)
        never = sum(line.busy for line in lines) / min(c, GENERATION)
        rows.append({"cores": c, "gain": rounded(waiting / never)})
    return rows


def population_seconds(
    generations: Sequence[Evaluations], members: int, cores: int, overhead: PoolOverhead
) -> float:
    """Mean seconds of a generation of so many members, its evaluations drawn from the
    measured ones of one generation each."""
    generator = np.random.default_rng(members)
    return float(
        np.mean(
            [
                simulate_pool(
                    list(generator.choice(g.seconds, members * EVALUATIONS_A_MEMBER)),
                    cores,
                    overhead,
                ).seconds
                for _ in range(DRAWS // len(generations))
                for g in generations
            ]
        )
    )


def larger_population(
    generations: Sequence[Evaluations], overhead: PoolOverhead
) -> list[dict[str, float]]:
    """Beside 16 members on the same cores: the largest population whose generation takes
    at most `SLACK` times as long, and the one that fills the cores (if larger): how many
    times as long it takes, how many times the evaluations a second that makes."""
    rows = []
    for cores in CORES:

        def relative(members: int, c: int = cores) -> float:
            one = population_seconds(generations, MEMBERS, c, overhead)
            return population_seconds(generations, members, c, overhead) / one

        filling = max(cores // EVALUATIONS_A_MEMBER, MEMBERS)
        times = relative(filling)
        rows.append(
            {
                "cores": cores,
                "at_equal_time": _largest(lambda members: relative(members) <= SLACK),
                "filling": filling,
                "filling_seconds": rounded(times),
                "filling_throughput": rounded(filling / MEMBERS / times),
            }
        )
    return rows


def _largest(allowed: Callable[[int], bool]) -> int:
    """The largest population that is allowed, 16 at least; by bisection."""
    low, high = MEMBERS, 2 * MEMBERS
    while allowed(high):
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low
