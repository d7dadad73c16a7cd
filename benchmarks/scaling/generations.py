"""Scenarios of one generation and of a run's start, from measured evaluations."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.scaling.recorded import (
    Evaluations,
    RecordedRun,
    VariedGeneration,
)
from benchmarks.scaling.simulation import PoolOverhead, Timeline, simulate_pool

#: Cluster sizes of the tables.
CORES = (16, 64, 256, 1024)
MEMBERS, EVALUATIONS_A_MEMBER = 16, 3
GENERATION = MEMBERS * EVALUATIONS_A_MEMBER
FRESH_AGENTS = {"confirmation": 32, "final score": 10}

DRAWS = 40  # random ones of what was not measured as it is

Cases = dict[str, Sequence[Evaluations]]


def cases(run: RecordedRun, varied: Sequence[VariedGeneration]) -> Cases:
    """Generations by what distinguishes them; those with varied agents are early in the
    first half of the run."""
    half = len(run.generations) / 2
    return {
        "fixed agents, early": run.early,
        "fixed agents, late": run.late,
        "varied agents, early": [one.evaluations for one in varied if one.generation < half],
        "varied agents, late": [one.evaluations for one in varied if one.generation >= half],
    }


def rounded(value: float) -> float:
    return float(f"{value:.4g}")


def summary(timelines: Sequence[Timeline]) -> dict[str, float]:
    """Of several generations: means, the shares weighted by time."""
    first = timelines[0]
    seconds = sum(line.seconds for line in timelines)
    busy = sum(line.busy for line in timelines)
    working = min(first.cores, first.evaluations)
    return {
        "cores": first.cores,
        "seconds": rounded(seconds / len(timelines)),
        "efficiency": rounded(busy / (first.cores * seconds)),
        "straggler_share": rounded(1 - busy / (working * seconds)),
    }


def by_cores(
    generations: Sequence[Evaluations], cores: Sequence[int], overhead: PoolOverhead
) -> list[dict[str, float]]:
    """A generation on each number of cores."""
    return [
        summary([simulate_pool(list(g.seconds), c, overhead) for g in generations]) for c in cores
    ]


def spread(generations: Sequence[Evaluations]) -> dict[str, float]:
    """Of the seconds of an evaluation: what decides about waiting."""
    seconds = np.concatenate([g.seconds for g in generations])
    longest = np.array([g.seconds.max() / g.seconds.mean() for g in generations])
    return {
        "evaluations": seconds.size,
        "mean_seconds": rounded(seconds.mean()),
        "median_seconds": rounded(float(np.median(seconds))),
        "coefficient_of_variation": rounded(seconds.std() / seconds.mean()),
        "longest_to_mean": rounded(longest.mean()),
        "mean_train_steps": rounded(np.concatenate([g.train_steps for g in generations]).mean()),
    }


def stages(run: RecordedRun, overhead: PoolOverhead) -> list[dict[str, Any]]:
    """What of a run is independent of each other, and how it fills the cores."""
    generator = np.random.default_rng(0)
    centre = np.concatenate([g.seconds[:MEMBERS] for g in run.late])
    parts: dict[str, list[NDArray[np.float64]]] = {
        "screening": [run.screening.seconds],
        "retests of the best": [run.retests.seconds],
        "generation, psi alone": [g.seconds[:MEMBERS] for g in run.generations],
        "generation without mirrored sampling": [g.seconds[: 2 * MEMBERS] for g in run.generations],
        "generation with mirrored sampling": [g.seconds for g in run.generations],
    }
    for name, agents in FRESH_AGENTS.items():
        parts[name] = [generator.choice(centre, agents) for _ in range(DRAWS)]
    rows = []
    for name, samples in parts.items():
        lines = {c: [simulate_pool(list(s), c, overhead) for s in samples] for c in CORES}
        efficiency = {str(c): summary(lines[c])["efficiency"] for c in CORES}
        rows.append({"stage": name, "independent": samples[0].size, "efficiency": efficiency})
    return rows
