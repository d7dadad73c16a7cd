"""Checkpoints of NES runs: one safetensors file with a JSON header."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Self

import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from bilevel.decode import decode, decode_json, differences
from bilevel.durable import checksum, write_aside
from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.hyperparameters import SEHyperparameters
from bilevel.nes.archive import Finalist
from bilevel.nes.confirmation import Confirmation
from bilevel.nes.records import GenerationRecord
from bilevel.nes.start import StartRace
from bilevel.nes.state import NESState
from bilevel.synthetic_env import SEDistribution, coordinates
from bilevel.tasks import ObservationScale, Task
from bilevel.version import RUN_FORMAT

#: The tensors of a checkpoint, besides those of the finalists.
_TENSORS = ("theta", "std_dev", "average", "observation_mean", "observation_deviation")


def save_state(state: NESState, path: Path | str) -> None:
    """Write a checkpoint durably. Raises StorageFailure."""
    header: dict[str, Any] = {"format": RUN_FORMAT, **asdict(_Header.of(state))}
    tensors = {
        "theta": state.se.mean,
        "std_dev": state.se.std_dev,
        "average": state.se.average,
        "observation_mean": state.scale.mean,
        "observation_deviation": state.scale.deviation,
    }
    tensors |= {f"finalist_{i}": f.theta for i, f in enumerate(state.finalists)}
    header["sha256"] = _checksum(json.dumps(header), tensors)
    # One entry: safetensors writes several in any order.
    write_aside(Path(path), safetensors.numpy.save(tensors, {"nes": json.dumps(header)}))


def load_state(
    path: Path | str,
    task: Task,
    hp: SEHyperparameters,
    provenance: Mapping[str, Any] | None = None,
) -> NESState:
    """Read a checkpoint of a run on `task` with such SEs (see also `NES.load`).

    Raises InvalidInput for a file that is missing or damaged, or of a run on another task or with
    another seed or other hyperparameters than those of `provenance` (but for the number of
    generations), OtherVersion for one of another format, and StorageFailure for one that cannot be
    read.
    """
    provenance = provenance or {}
    try:
        Path(path).read_bytes()
    except FileNotFoundError:
        raise InvalidInput(f"no checkpoint at {str(path)!r}") from None
    except OSError as error:  # of the disk, not of what is on it
        reason = error.strerror or str(error)
        raise StorageFailure(f"cannot read checkpoint {str(path)!r}: {reason}") from None
    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if "se" in metadata:
            raise _OtherRun(f"{str(path)!r} is an SE file, not a checkpoint")
        found = decode_json(dict[str, Any], metadata.get("nes", ""), "header")
        if found.pop("sha256", None) != _checksum(json.dumps(found), tensors):
            raise InvalidInput("its checksum is wrong")
        if (written := found.pop("format", 1)) != RUN_FORMAT:
            raise OtherVersion(f"checkpoint {str(path)!r}", written, RUN_FORMAT)
        header = decode(_Header, found, "header")
        _require_run(header, task, provenance, f"the checkpoint {str(path)!r}")
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
        del same["scale_steps"], same["seed"], same["run"]
        se = SEDistribution(space, theta, std_dev, average)
        state = NESState(task=task, se=se, scale=scale, provenance=provenance, **same)
    except (OtherVersion, _OtherRun):
        raise
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInput(f"damaged checkpoint {str(path)!r}: {reason}") from None
    return state


class _OtherRun(InvalidInput):
    """A sound file that is not of this run."""


def _made_by(task: Task, provenance: Mapping[str, Any]) -> dict[str, Any]:
    """What a run's states depend on besides its seed, but for its length and name."""
    hp = dict(provenance.get("hyperparameters", {}))
    hp.pop("recipe", None)
    if "nes" in hp:
        hp["nes"] = {name: value for name, value in hp["nes"].items() if name != "generations"}
    return {"task": asdict(task), **hp}


def _require_run(header: "_Header", task: Task, provenance: Mapping[str, Any], what: str) -> None:
    """Raise _OtherRun if the checkpoint is of another run, as far as both tell."""
    seed = provenance.get("seed", header.seed)
    if header.seed not in (None, seed):
        raise _OtherRun(f"{what} is of a run with seed {header.seed}, not {seed}")
    now = json.loads(json.dumps(_made_by(task, provenance)))
    both = header.run.keys() & now.keys()
    told, asked = ({name: run[name] for name in both} for run in (header.run, now))
    for name, then, value in differences(told, asked):
        raise _OtherRun(f"{what} is of a run with {name} = {then}, not {value}")


@dataclass(frozen=True)
class _Finalist:
    """The fields of a `Finalist` that are no tensors."""

    generation: int
    score_mean: float
    perturbed_score_mean: float

    @classmethod
    def of(cls, finalist: Finalist) -> Self:
        return cls(**{spec.name: getattr(finalist, spec.name) for spec in fields(cls)})


@dataclass(frozen=True)
class _Header:
    """The fields of a `NESState` that are no tensors."""

    generation: int
    attempt: int
    attempt_began: int
    race: StartRace | None
    judged: int
    confirmation: Confirmation | None
    confirmed: bool
    refuted: int
    real_env_steps: int
    cost: float
    scale_steps: int  # of the scale of observations
    finished: bool
    finalists: tuple[_Finalist, ...]
    records: tuple[GenerationRecord, ...]
    seed: int | None = None  # of the run; a state without provenance has none
    run: dict[str, Any] = field(default_factory=dict)  # see `_made_by`

    @classmethod
    def of(cls, state: NESState) -> Self:
        same = [spec.name for spec in fields(cls) if hasattr(state, spec.name)]
        others: dict[str, Any] = {
            "scale_steps": state.scale.real_env_steps,
            "finalists": tuple(map(_Finalist.of, state.finalists)),
            "seed": state.provenance.get("seed"),
            "run": _made_by(state.task, state.provenance),
        }
        return cls(**{name: getattr(state, name) for name in same} | others)


def _checksum(text: str, tensors: Mapping[str, NDArray[Any]]) -> str:
    """Checksum of a header and of tensors, dtypes and shapes included."""
    parts = [text.encode()]
    for name in sorted(tensors):
        tensor = tensors[name]
        parts += [f"{name} {tensor.dtype} {tensor.shape}".encode(), tensor.tobytes()]
    return checksum(*parts)
