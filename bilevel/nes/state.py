"""What an NES run carries from one generation to the next, on disk and in memory."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from bilevel.decode import decode, decode_json
from bilevel.durable import checksum, write_aside
from bilevel.errors import InvalidInput
from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import NESHyperparameters, SEHyperparameters
from bilevel.nes.confirmation import Confirmation
from bilevel.nes.records import FINALISTS, Finalist, GenerationRecord
from bilevel.nes.start import StartRace
from bilevel.synthetic_env import SE, SEDistribution, StoredSE, coordinates
from bilevel.synthetic_env.coordinates import Theta
from bilevel.tasks import ObservationScale, Task


@dataclass(frozen=True)
class NESState:
    """The run after `generation` generations.

    A run may degrade after it has solved the task, so the best SEs are kept beside the current
    one; several of them, because a score is a sample of agents and the highest one a lucky
    sample: the end of a run retests them all.
    """

    task: Task
    se: SEDistribution
    scale: ObservationScale
    # Hyperparameters, seed and version of the run, which the files of its SEs tell.
    provenance: Mapping[str, Any] = field(default_factory=dict)
    generation: int = 0
    attempt: int = 0  # how often the run has begun again from other random SEs
    attempt_began: int = 0  # the generation in which it did last
    race: StartRace | None = None  # while the start of the attempt is being chosen
    judged: int = 0  # generations up to the last confirmation, or the attempt's begin
    real_env_steps: int = 0  # steps on the real task so far
    confirmation: Confirmation | None = None  # while one is under way
    confirmed: bool = False  # solved for long enough, and confirmed
    refuted: int = 0  # confirmations that failed, in this attempt
    finished: bool = False  # confirmed, or out of generations
    finalists: tuple[Finalist, ...] = ()  # best first
    records: tuple[GenerationRecord, ...] = ()

    @property
    def started(self) -> bool:
        """Whether the start is chosen."""
        return self.race is None

    @property
    def best(self) -> StoredSE:
        """The SE to hand over: the current one if it is confirmed, else the one whose agents scored
        highest (before the first generation the current one)."""
        if self.confirmed or not self.finalists:
            return self.current
        return self.candidates[0]

    @property
    def current(self) -> StoredSE:
        """The unperturbed SE as it is now, after the last step."""
        return self._stored(self.se.centre, generation=self.generation)

    @property
    def candidates(self) -> list[StoredSE]:
        """The SEs whose agents scored highest, best first."""
        return [
            self._stored(
                self.se.at(f.theta),
                generation=f.generation,
                score_mean=f.score_mean,
                perturbed_score_mean=f.perturbed_score_mean,
                train_steps_mean=self.records[f.generation].train_steps_mean,
            )
            for f in self.finalists
        ]

    def _stored(self, se: SE, **info: object) -> StoredSE:
        task, told = self.task, {**self.provenance, "real_env_steps": self.real_env_steps, **info}
        return StoredSE(se, task.id, task.step_limit, task.solved_reward, told)

    @property
    def best_score(self) -> float:
        """Highest mean score of a generation so far (-inf before the first)."""
        return max((record.score_mean for record in self.records), default=-math.inf)

    @property
    def objective(self) -> float:
        """Mean over the generations of the score of each: the area under the learning curve, so
        that soon and good both count."""
        return float(np.mean([record.score_mean for record in self.records]))

    def record_of(
        self, results: Sequence[EvaluationResult], centre_agents: int, step: Theta
    ) -> GenerationRecord:
        """The record of a generation's `results`, in the order of their requests, and of its update
        `step` (D,)."""
        scores = np.array([result.score for result in results])
        centre, on_centre = scores[:centre_agents], results[:centre_agents]
        seconds = sum(result.seconds for result in results)
        train_steps = sum(result.train_steps for result in results)
        return GenerationRecord(
            generation=self.generation,
            attempt=self.attempt,
            score_mean=float(centre.mean()),
            score_std=float(centre.std()),
            score_best=float(centre.max()),
            perturbed_score_mean=float(scores[centre_agents:].mean()),
            train_steps_mean=float(np.mean([r.train_steps for r in on_centre])),
            train_episodes_mean=float(np.mean([r.train_episodes for r in on_centre])),
            solved_fraction=float((centre >= self.task.solved_reward).mean()),
            non_finite=sum(not r.finite for r in results),
            real_env_steps=self.real_env_steps,
            psi_norm=float(np.linalg.norm(self.se.centre.psi)),
            update_norm=float(np.linalg.norm(step)),
            std_dev=float(np.sqrt(np.mean(np.square(self.se.std_dev)))),
            evaluation_seconds=seconds,
            env_steps_per_second=train_steps / max(seconds, 1e-9),
        )

    def solved_for_long(self, nes: NESHyperparameters) -> bool:
        """Whether the last `nes.solved_for` generations, none of which a confirmation has judged,
        solve the task on average."""
        if not 0 < nes.solved_for <= self.generation - self.judged:
            return False
        recent = [record.score_mean for record in self.records[-nes.solved_for :]]
        return float(np.mean(recent)) >= self.task.solved_reward

    def with_finalist(self, finalist: Finalist) -> tuple[Finalist, ...]:
        """The finalists when this one has entered."""
        ranked = sorted([*self.finalists, finalist], key=lambda f: f.rank, reverse=True)
        return tuple(ranked[:FINALISTS])

    def timed(self, seconds: float, cores: int, finished: float) -> Self:
        """With the measured times of the last generation (`GenerationRecord.timed`)."""
        *before, last = self.records
        return replace(self, records=(*before, last.timed(seconds, cores, finished)))

    def save(self, path: Path) -> None:
        """Write durably. Raises StorageFailure."""
        header: dict[str, Any] = {
            "generation": self.generation,
            "attempt": self.attempt,
            "attempt_began": self.attempt_began,
            "race": None if self.race is None else asdict(self.race),
            "judged": self.judged,
            "confirmation": None if self.confirmation is None else asdict(self.confirmation),
            "confirmed": self.confirmed,
            "refuted": self.refuted,
            "real_env_steps": self.real_env_steps,
            "scale_steps": self.scale.real_env_steps,
            "finished": self.finished,
            "finalists": [
                {f.name: getattr(finalist, f.name) for f in fields(Finalist) if f.name != "theta"}
                for finalist in self.finalists
            ],
            "records": [asdict(record) for record in self.records],
        }
        tensors = {
            "theta": self.se.mean,
            "std_dev": self.se.std_dev,
            "average": self.se.average,
            "observation_mean": self.scale.mean,
            "observation_deviation": self.scale.deviation,
        }
        tensors |= {f"finalist_{i}": f.theta for i, f in enumerate(self.finalists)}
        header["sha256"] = _checksum(json.dumps(header), tensors)
        # One entry: safetensors writes several in any order.
        write_aside(path, safetensors.numpy.save(tensors, {"nes": json.dumps(header)}))

    @classmethod
    def load(
        cls,
        path: Path,
        task: Task,
        hp: SEHyperparameters,
        provenance: Mapping[str, Any] | None = None,
    ) -> "NESState":
        """The inverse of `save`, of a run on `task` with such SEs (see also `NES.load`). Raises
        InvalidInput for a damaged file."""
        try:
            with safetensors.safe_open(path, framework="numpy") as file:
                metadata = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            told = decode_json(dict[str, Any], metadata.get("nes", ""), "header")
            if told.pop("sha256", None) != _checksum(json.dumps(told), tensors):
                raise InvalidInput("its checksum is wrong")
            header = decode(_Header, told, "header")
            finalists = [f"finalist_{i}" for i in range(len(header.finalists))]
            if tensors.keys() != {*_TENSORS, *finalists}:
                raise InvalidInput("its parts do not fit together")
            theta, std_dev, average, mean, deviation = (tensors[name] for name in _TENSORS)
            scale = ObservationScale(mean, deviation, header.scale_steps)
            space = coordinates(task, hp, scale)
            shapes = {tensors[name].shape for name in ("theta", "std_dev", "average", *finalists)}
            if header.generation != len(header.records) or shapes != {(space.size,)}:
                raise InvalidInput("its parts do not fit together")
            same = vars(header) | {
                "finalists": tuple(
                    Finalist(theta=tensors[name], **vars(finalist))
                    for name, finalist in zip(finalists, header.finalists, strict=True)
                )
            }
            del same["scale_steps"]
            se = SEDistribution(space, theta, std_dev, average)
            return cls(task=task, se=se, scale=scale, provenance=provenance or {}, **same)
        except (SafetensorError, OSError, ValueError, TypeError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InvalidInput(f"damaged checkpoint {str(path)!r}: {reason}") from None


@dataclass(frozen=True)
class _Finalist:
    """What the header tells of a `Finalist`."""

    generation: int
    score_mean: float
    perturbed_score_mean: float


@dataclass(frozen=True)
class _Header:
    """What a checkpoint holds besides tensors, under the names that `NESState` has."""

    generation: int
    attempt: int
    attempt_began: int
    race: StartRace | None
    judged: int
    confirmation: Confirmation | None
    confirmed: bool
    refuted: int
    real_env_steps: int
    scale_steps: int  # of the scale of observations
    finished: bool
    finalists: tuple[_Finalist, ...]
    records: tuple[GenerationRecord, ...]


#: The tensors of a checkpoint, besides those of the finalists.
_TENSORS = ("theta", "std_dev", "average", "observation_mean", "observation_deviation")


def _checksum(text: str, tensors: Mapping[str, NDArray[np.float32]]) -> str:
    """Of a checkpoint's header and tensors, dtypes and shapes included."""
    parts = [text.encode()]
    for name in sorted(tensors):
        tensor = tensors[name]
        parts += [f"{name} {tensor.dtype} {tensor.shape}".encode(), tensor.tobytes()]
    return checksum(*parts)
