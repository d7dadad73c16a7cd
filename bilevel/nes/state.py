"""The state of an NES run, which a checkpoint stores as a whole."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field

from bilevel.evolution import Genotype, SearchDistribution
from bilevel.hyperparameters import NESHyperparameters
from bilevel.nes.confirmation import Confirming
from bilevel.nes.records import GenerationRecord
from bilevel.nes.start import ChoosingStart
from bilevel.tasks import ObservationScale

#: Number of SEs that a run keeps for its end.
FINALISTS = 4


@dataclass(frozen=True)
class Evolving:
    """Phase of a run: generations of the evolution strategy."""

    phase: Literal["evolving"] = "evolving"


@dataclass(frozen=True)
class Finished:
    """Phase of a run: solved, or out of generations."""

    confirmed: bool = False  #: whether fresh agents confirmed the current SE
    phase: Literal["finished"] = "finished"


Phase = ChoosingStart | Evolving | Confirming | Finished


@dataclass(frozen=True)
class Finalist:
    """One of the best SEs so far, which `bilevel nes` tests again if none is confirmed."""

    genotype: Genotype  # (D,)
    generation: int
    score_mean: float
    perturbed_score_mean: float

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key, higher is better; ties go to the SE whose perturbations score higher."""
        return self.score_mean, self.perturbed_score_mean


def best_finalists(
    finalists: Sequence[Finalist], genotype: Genotype, record: GenerationRecord
) -> tuple[Finalist, ...]:
    """Return the FINALISTS best SEs, including the new generation; ties go to earlier ones."""
    new = Finalist(genotype, record.generation, record.score_mean, record.perturbed_score_mean)
    ranked = sorted([*finalists, new], key=lambda finalist: finalist.rank, reverse=True)
    return tuple(ranked[:FINALISTS])


@dataclass(frozen=True)
class NESState:
    """The run after `generation` generations. `bilevel.nes.NES` interprets it."""

    phase: Annotated[Phase, Field(discriminator="phase")]
    search: SearchDistribution
    scale: ObservationScale
    generation: int = 0
    attempt: int = 0  #: number of restarts
    attempt_start: int = 0  #: generation of the last restart
    last_judged: int = 0  #: generation of the last confirmation or restart
    refuted: int = 0  #: failed confirmations in this attempt
    real_env_steps: int = 0  #: steps on the real task so far
    cost: float = 0.0  #: core seconds so far, estimated (`core_seconds`, `step_seconds`)
    finalists: tuple[Finalist, ...] = ()  #: best first
    records: tuple[GenerationRecord, ...] = ()

    @property
    def finished(self) -> bool:
        """The run has finished."""
        return isinstance(self.phase, Finished)

    @property
    def confirmed(self) -> bool:
        """Fresh agents have confirmed the current SE."""
        return isinstance(self.phase, Finished) and self.phase.confirmed

    @property
    def best_score(self) -> float:
        """Highest mean score of a generation so far (-inf before the first)."""
        return max((record.score_mean for record in self.records), default=-math.inf)

    def solved(self, nes: NESHyperparameters, solved_reward: float) -> bool:
        """Return whether the last `nes.solved_for` generations, all after the last confirmation,
        solve the task on average."""
        if not 0 < nes.solved_for <= self.generation - self.last_judged:
            return False
        recent = [record.score_mean for record in self.records[-nes.solved_for :]]
        return float(np.mean(recent)) >= solved_reward

    def stagnates(self, nes: NESHyperparameters, solved_reward: float) -> bool:
        """Return whether this attempt has not solved the task, nor improved for a while."""
        scores = [record.score_mean for record in self.records[self.attempt_start :]]
        if not nes.restart_after or not scores or max(scores) >= solved_reward:
            return False
        return len(scores) - 1 - int(np.argmax(scores)) >= nes.restart_after

    def timed(self, seconds: float, cores: int, finished: float) -> Self:
        """Add the measured times of the last generation (`GenerationRecord.timed`)."""
        *earlier, last = self.records
        return replace(self, records=(*earlier, last.timed(seconds, cores, finished)))
