"""What an NES run carries from one generation to the next, on disk and in memory."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from bilevel.durable import checksum, write_aside
from bilevel.errors import InvalidInput
from bilevel.nes.fitness import worth_of


@dataclass(frozen=True)
class GenerationRecord:
    """One generation, as reported everywhere.

    Scores are mean returns on the real task; `score_*`, `fitness_mean`, `train_*` and
    `solved_fraction` are of the agents trained on psi itself.
    """

    generation: int  # from 0
    score_mean: float
    score_std: float
    score_best: float
    perturbed_score_mean: float  # of the agents trained on psi +- eps
    fitness_mean: float  # mean of `fitness`: scores, less what train steps cost
    train_steps_mean: float  # environment steps on the SE
    train_episodes_mean: float
    solved_fraction: float  # of the agents trained on psi
    non_finite: int  # evaluations of the generation whose numbers diverged
    psi_norm: float
    update_norm: float
    std_dev: float  # sigma of this generation's perturbations
    retention: float  # share of psi's score, above the worst, that psi +- eps had; 0 to 1
    env_steps_per_second: float  # of one core
    generation_seconds: float
    core_utilisation: float  # share of the cores' time that was spent in evaluations
    finished: float  # unix time, seconds


#: SEs that a run keeps for the end.
FINALISTS = 4


@dataclass(frozen=True)
class Finalist:
    """An SE of a past generation, with what it scored then; on average over several
    generations, where the run came back to it."""

    psi: NDArray[np.float32]  # (P,)
    generation: int  # the first
    score_mean: float
    fitness_mean: float
    perturbed_score_mean: float
    score_error: float  # standard error of score_mean
    generations: int = 1

    def rank(self, solved_reward: float) -> tuple[float, float, float]:
        """Higher is better; among equals the one whose neighbours score higher."""
        worth = worth_of(self.score_mean, self.fitness_mean, solved_reward)
        return *worth, self.perturbed_score_mean

    def with_generation(self, other: "Finalist") -> "Finalist":
        """The same SE, with what it scored in one more generation."""
        n = self.generations
        return replace(
            self,
            score_mean=(n * self.score_mean + other.score_mean) / (n + 1),
            fitness_mean=(n * self.fitness_mean + other.fitness_mean) / (n + 1),
            perturbed_score_mean=(n * self.perturbed_score_mean + other.perturbed_score_mean)
            / (n + 1),
            score_error=math.hypot(n * self.score_error, other.score_error) / (n + 1),
            generations=n + 1,
        )

    def surpasses(self, other: "Finalist", errors: float, solved_reward: float) -> bool:
        """Whether its score is higher by more than so many standard errors of the
        difference, what is beyond the solved reward apart."""
        ours, theirs = min(self.score_mean, solved_reward), min(other.score_mean, solved_reward)
        return ours - theirs > errors * math.hypot(self.score_error, other.score_error)


@dataclass(frozen=True)
class NESState:
    """The run after `generation` generations.

    A run may degrade after it has solved the task, so the best SEs are kept beside
    the current one; several of them, because a score is a sample of agents and the
    highest one a lucky sample: the end of a run retests them all.
    """

    psi: NDArray[np.float32]  # (P,)
    velocity: NDArray[np.float32]  # (P,), the step that led to psi
    generation: int = 0
    scale: float = 1.0  # of std_dev and step_size, adapted
    solved_streak: int = 0  # generations solved in a row, up to the last one
    finalists: tuple[Finalist, ...] = ()  # best first
    records: tuple[GenerationRecord, ...] = ()

    @classmethod
    def of(cls, psi: NDArray[np.float32]) -> Self:
        """Before the first generation."""
        return cls(psi, np.zeros_like(psi))

    @property
    def best_score(self) -> float:
        """Highest mean score of a generation so far (-inf before the first)."""
        return max((record.score_mean for record in self.records), default=-math.inf)

    @property
    def objective(self) -> float:
        """Mean over the generations of the fitness of each: the area under the learning curve,
        so that soon and good both count, and with a step price what agents learn from in few
        steps."""
        return float(np.mean([record.fitness_mean for record in self.records]))

    def as_finalist(self, tried: Finalist) -> Finalist:
        """What was just tried, together with what it scored before if it is a finalist."""
        for finalist in self.finalists:
            if np.array_equal(finalist.psi, tried.psi):
                return finalist.with_generation(tried)
        return tried

    def with_finalist(self, finalist: Finalist, solved_reward: float) -> tuple[Finalist, ...]:
        """The finalists when this one has entered."""
        others = [f for f in self.finalists if f.generation != finalist.generation]
        ranked = sorted([*others, finalist], key=lambda f: f.rank(solved_reward), reverse=True)
        return tuple(ranked[:FINALISTS])

    def save(self, path: Path) -> None:
        """Write durably. Raises StorageFailure."""
        header: dict[str, Any] = {
            "generation": self.generation,
            "scale": self.scale,
            "solved_streak": self.solved_streak,
            "finalists": [
                {f.name: getattr(finalist, f.name) for f in fields(Finalist) if f.name != "psi"}
                for finalist in self.finalists
            ],
            "records": [asdict(record) for record in self.records],
        }
        tensors = {"psi": self.psi, "velocity": self.velocity}
        tensors |= {f"finalist_{i}": f.psi for i, f in enumerate(self.finalists)}
        header["sha256"] = _checksum(json.dumps(header), tensors)
        # One entry: safetensors writes several in any order.
        write_aside(path, safetensors.numpy.save(tensors, {"nes": json.dumps(header)}))

    @classmethod
    def load(cls, path: Path) -> "NESState":
        """The inverse of `save`. Raises InvalidInput for a damaged file."""
        try:
            with safetensors.safe_open(path, framework="numpy") as file:
                metadata = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            header = json.loads(metadata["nes"])
            if header.pop("sha256") != _checksum(json.dumps(header), tensors):
                raise ValueError("its checksum is wrong")
            psi, velocity = tensors["psi"], tensors["velocity"]
            finalists = tuple(
                Finalist(psi=tensors[f"finalist_{i}"], **values)
                for i, values in enumerate(header["finalists"])
            )
            records = tuple(GenerationRecord(**record) for record in header["records"])
            generation, scale = int(header["generation"]), float(header["scale"])
            streak = int(header["solved_streak"])
            shapes = {psi.shape, velocity.shape, *(finalist.psi.shape for finalist in finalists)}
            if generation != len(records) or len(shapes) > 1 or not 0 < scale < math.inf:
                raise ValueError("its parts do not fit together")
            return cls(psi, velocity, generation, scale, streak, finalists, records)
        except _DAMAGE as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InvalidInput(f"damaged checkpoint {str(path)!r}: {reason}") from None


#: What reading a file that is not what it should be may raise.
_DAMAGE = (
    SafetensorError,
    OSError,
    ValueError,
    TypeError,
    KeyError,
    AttributeError,
    OverflowError,
    RecursionError,
)


def _checksum(text: str, tensors: Mapping[str, NDArray[np.float32]]) -> str:
    """Of a checkpoint's header and tensors, dtypes and shapes included."""
    parts = [text.encode()]
    for name in sorted(tensors):
        tensor = tensors[name]
        parts += [f"{name} {tensor.dtype} {tensor.shape}".encode(), tensor.tobytes()]
    return checksum(*parts)
