"""The committed measurements, as the scenarios take them."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import RESULTS
from benchmarks.scaling.simulation import PoolOverhead, StudyOverhead

TASKS = ("CartPole-v0", "Acrobot-v1")

#: Generations that count as early and as late: the first and the last so many of a run.
PHASE = 5


def load(name: str) -> dict[str, Any]:
    """`results/scaling_NAME.json`."""
    content: dict[str, Any] = json.loads((RESULTS / f"scaling_{name}.json").read_text())
    return content


@dataclass(frozen=True)
class Evaluations:
    """Some evaluations (n,) in the order of their requests."""

    train_steps: NDArray[np.int64]
    seconds: NDArray[np.float64]

    @classmethod
    def of(cls, row: dict[str, Any]) -> "Evaluations":
        """From a row of a result."""
        return cls(np.array(row["train_steps"]), np.array(row["seconds"]))


@dataclass(frozen=True)
class RecordedRun:
    """One NES run; 48 evaluations a generation."""

    task: str
    screening: Evaluations
    retests: Evaluations
    generations: tuple[Evaluations, ...]
    between: float  # seconds between two generations (mean)

    @property
    def early(self) -> tuple[Evaluations, ...]:
        """The first generations."""
        return self.generations[:PHASE]

    @property
    def late(self) -> tuple[Evaluations, ...]:
        """The last generations."""
        return self.generations[-PHASE:]


def recorded_run(task: str) -> RecordedRun:
    """The run of `benchmarks.scaling.nes_runs`."""
    result = load(f"nes_{task}")
    rows = result["generations"]
    return RecordedRun(
        task,
        Evaluations.of(result["screening"]),
        Evaluations.of(result["retests"]),
        tuple(Evaluations.of(row) for row in rows),
        float(np.mean([row["between_seconds"] for row in rows])),
    )


@dataclass(frozen=True)
class VariedGeneration:
    """A generation whose members' agents differ."""

    generation: int
    evaluations: Evaluations
    agents: NDArray[np.int64]  # (members, 3): hidden layers, hidden size, batch size

    @property
    def work(self) -> NDArray[np.float64]:
        """Multiplications (n,) of a forward pass over a minibatch, up to a factor: known
        before the evaluation. Mirrored pairs share their agent."""
        layers, hidden, batch = self.agents.T.astype(float)
        inputs_and_outputs = 6  # states and Q-values; of little weight
        member = batch * hidden * (hidden * (layers - 1) + inputs_and_outputs)
        return np.tile(member, self.evaluations.seconds.size // member.size)


def varied_generations(task: str) -> tuple[VariedGeneration, ...]:
    """Early and late, of `benchmarks.scaling.agents`."""
    return tuple(
        VariedGeneration(row["generation"], Evaluations.of(row), np.array(row["agents"]))
        for row in load(f"agents_{task}")["varied"]
    )


def configuration_levels(task: str) -> NDArray[np.float64]:
    """Mean seconds (configurations,) of an evaluation on an untrained SE, for random
    configurations of the paper's search space."""
    return np.array([np.mean(row["seconds"]) for row in load(f"agents_{task}")["configurations"]])


def pool_overhead() -> PoolOverhead:
    """Of the real pool with one actor, seconds."""
    one = load("pool")["overhead"][0]
    driver = one["driver_ms"]
    return PoolOverhead(driver / 1e3, (one["actor_ms"] - one["evaluation_ms"] - driver) / 1e3)


def study_overhead() -> StudyOverhead:
    """Of the real search's driver, seconds."""
    measured = load("study")["driver_overhead"]
    return StudyOverhead(
        measured["job_seconds"], measured["report_seconds"], measured["start_seconds"]
    )
