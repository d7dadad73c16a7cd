"""A whole NES generation with all that belongs to it (actor pool, checkpoint, MLflow):
where its time goes, and how much faster two actors are than one.

    run with two actors, up to the last of the generations to be compared
    repeat:
        for actors in 1, 2:
            run those generations again, each from the state before it

    python -m benchmarks.speed.generation

part      of the actors' time (actors x seconds)
-------   ------------------------------------------------------------------------
kernels   evaluations (`EvaluationResult.seconds`)
waiting   actors that have nothing left to do while others end the last evaluations
ray       the rest of the pool's time: requests and results on their way
python    ask, tell and the checkpoint, during which all actors are idle
mlflow    likewise, the record on its way to MLflow's database (in a run of the product
          that is a thread's, beside the next generation)
"""

import statistics
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from benchmarks.machine import spread, write_result
from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import load_preset
from bilevel.nes import NESState
from bilevel.tasks import get_task
from cluster.home import Home
from cluster.nes_loop import NESRun
from cluster.pool import EvaluationPool
from cluster.ray_cluster import ray_cluster
from cluster.tracking import Point, RunView, Tracker

#: Generations to be compared: early and late ones.
CASES = {"CartPole-v0": (2, 12, 22), "Acrobot-v1": (1, 5)}
ACTORS = (1, 2)
REPEATS = 3
START_CANDIDATES = 16


@dataclass(frozen=True)
class Parts:
    """Where the actors' time went; seconds of one actor."""

    kernels: float
    waiting: float
    ray: float
    python: float
    mlflow: float

    @property
    def total(self) -> float:
        """Actors x seconds."""
        return float(sum(getattr(self, field.name) for field in fields(self)))

    def shares(self) -> dict[str, float]:
        """Of the total."""
        return {f.name: round(getattr(self, f.name) / self.total, 4) for f in fields(self)}

    @classmethod
    def sum(cls, parts: Sequence[Self]) -> Self:
        """Of several generations."""
        return cls(*(sum(getattr(part, f.name) for part in parts) for f in fields(cls)))


def generation(
    run: NESRun, state: NESState, pool: EvaluationPool, tracker: Tracker, name: str
) -> tuple[NESState, float, Parts]:
    """The state after one generation, its seconds, and its parts."""
    ends: list[float] = []
    evaluations: list[EvaluationResult] = []

    def on_result(result: EvaluationResult) -> None:
        ends.append(time.perf_counter())
        evaluations.append(result)

    started = time.perf_counter()
    run.nes.ask(state)
    asking = time.perf_counter() - started

    started = time.perf_counter()
    state = run.advance(state, pool, on_result)
    told = time.perf_counter()
    point = Point.of(state.records[-1])
    tracker.show(RunView(name, name, "RUNNING", point.time, None, {}, {}, (point,)))
    seconds = time.perf_counter() - started

    actors = pool.size
    # The last evaluations of a generation end on an actor each, which gets no other.
    waiting = sum(ends[-1] - end for end in ends[-actors:])
    kernels = sum(result.seconds for result in evaluations)
    python = actors * (asking + told - ends[-1])
    mlflow = actors * (started + seconds - told)
    ray = actors * seconds - kernels - waiting - python - mlflow
    return state, seconds, Parts(kernels, waiting, ray, python, mlflow)


def measure(task_id: str, generations: Sequence[int], home: Home) -> dict[str, Any]:
    """One task's figures. Raises AssertionError if the number of actors changed a result."""
    hp = load_preset("tuned", task_id, "antithetic")
    hp = replace(hp, nes=replace(hp.nes, start_candidates=START_CANDIDATES))
    run = NESRun(get_task(task_id), hp, 0, home.folder / task_id)
    tracker = Tracker(home.database_uri, task_id, home.artifacts)
    states, along = [], []
    with EvaluationPool(ACTORS[-1]) as pool:
        state = run.open(pool)
        while state.generation <= max(generations):
            states.append(state)
            state, _, parts = generation(run, state, pool, tracker, task_id)
            along.append(parts)
    states.append(state)

    seconds: dict[int, list[float]] = {actors: [] for actors in ACTORS}
    shares: dict[int, list[dict[str, float]]] = {actors: [] for actors in ACTORS}
    for repeat in range(REPEATS):
        for actors in ACTORS:
            name = f"{task_id}, {actors} actors, repeat {repeat}"
            spent: list[float] = []
            measured: list[Parts] = []
            with EvaluationPool(actors) as pool:
                pool.run(run.task, run.nes.architecture, states[0].psi, run.nes.ask(states[0]))
                for number in generations:
                    after, wall, parts = generation(run, states[number], pool, tracker, name)
                    np.testing.assert_array_equal(after.psi, states[number + 1].psi)
                    spent.append(wall)
                    measured.append(parts)
            seconds[actors].append(sum(spent))
            shares[actors].append(Parts.sum(measured).shares())
            print(f"{name}: {seconds[actors][-1]:.2f} s, {shares[actors][-1]}", flush=True)
    one, two = (seconds[actors] for actors in ACTORS)
    return {
        "generations": list(generations),
        "evaluations_each": hp.nes.evaluations,
        "seconds": {str(actors): spread(seconds[actors]) for actors in ACTORS},
        "shares": {str(actors): _medians(shares[actors]) for actors in ACTORS},
        "two_actors_over_one": spread([a / b for a, b in zip(one, two, strict=True)]),
        "whole_run": {
            "actors": ACTORS[-1],
            "generations": len(along),
            "shares": Parts.sum(along).shares(),
        },
    }


def _medians(shares: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: statistics.median(row[name] for row in shares) for name in shares[0]}


def main() -> None:
    """Measure both tasks, write `results/generation.json`."""
    results = {}
    with tempfile.TemporaryDirectory() as folder, ray_cluster("local"):
        home = Home(Path(folder))
        home.prepare()
        for task_id, generations in CASES.items():
            results[task_id] = measure(task_id, generations, home)
    path = write_result(
        "generation",
        "python -m benchmarks.speed.generation",
        {"repeats": REPEATS, "results": results},
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
