"""Checkpoints of NES runs: an `NESState` as one safetensors file with a JSON header."""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from pydantic import BaseModel
from safetensors import SafetensorError

from bilevel.decode import decode_json, differences
from bilevel.durable import checksum, write_aside
from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.nes.state import NESState
from bilevel.tasks import Task
from bilevel.version import RUN_FORMAT

_Tensors = dict[str, NDArray[Any]]


def save_state(
    state: NESState, path: Path | str, task: Task, provenance: Mapping[str, Any]
) -> None:
    """Write a checkpoint durably. Raises StorageFailure."""
    tensors: _Tensors = {}
    run, packed = _run_settings(task, provenance), _pack(state, "state", tensors)
    header = {"format": RUN_FORMAT, "run": run, "state": packed}
    header["sha256"] = _checksum(header, tensors)
    # One metadata entry, because safetensors writes several in random order.
    write_aside(Path(path), safetensors.numpy.save(tensors, {"nes": json.dumps(header)}))


def load_state(
    path: Path | str, task: Task | None = None, provenance: Mapping[str, Any] | None = None
) -> NESState:
    """Read a checkpoint. If `task` and `provenance` are given, it must belong to their run, except
    for the number of generations and the recipe's name.

    Raises InvalidInput for a missing or damaged file, or another run's, OtherVersion for another
    format, and StorageFailure for a file that cannot be read.
    """
    name = f"checkpoint {str(path)!r}"
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise InvalidInput(f"no checkpoint at {str(path)!r}") from None
    except OSError as error:
        raise StorageFailure(f"cannot read {name}: {error.strerror or error}") from None
    try:
        header, tensors = _parse(content)
        run, written = header["run"], header["format"]
        # Another format may have another state.
        state = _decoded(header["state"], tensors) if written == RUN_FORMAT else None
    except (SafetensorError, ValueError, TypeError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise InvalidInput(f"damaged {name}: {reason}") from None
    if state is None:
        raise OtherVersion(name, written, RUN_FORMAT)
    if task is not None and provenance is not None:
        current = json.loads(json.dumps(_run_settings(task, provenance)))
        for setting, stored, value in differences(run, current):
            raise InvalidInput(
                f"the {name} belongs to a run with {setting} = {stored}, not {value}"
            )
    return state


class _Checkpoint(BaseModel, arbitrary_types_allowed=True, extra="forbid"):
    """Validates the state; arrays are an arbitrary type to pydantic."""

    state: NESState


def _run_settings(task: Task, provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the states of a run depend on: not its length, and not its recipe's name."""
    hp = dict(provenance["hyperparameters"])
    del hp["recipe"]
    hp["nes"] = {name: value for name, value in hp["nes"].items() if name != "generations"}
    return {"task": asdict(task), "seed": provenance["seed"], **hp}


def _pack(value: Any, path: str, tensors: _Tensors) -> Any:
    """Return plain values of nested dataclasses, and move arrays to `tensors`."""
    if isinstance(value, np.ndarray):
        tensors[path] = value
        return {"tensor": path}
    if is_dataclass(value):
        names = [spec.name for spec in fields(value)]
        return {name: _pack(getattr(value, name), f"{path}.{name}", tensors) for name in names}
    if isinstance(value, tuple):
        return [_pack(item, f"{path}.{i}", tensors) for i, item in enumerate(value)]
    return value


def _unpack(value: Any, tensors: _Tensors) -> Any:
    """Invert `_pack`, up to the types of dataclasses and tuples."""
    if isinstance(value, dict):
        if value.keys() == {"tensor"}:
            return tensors[value["tensor"]]
        return {name: _unpack(item, tensors) for name, item in value.items()}
    return [_unpack(item, tensors) for item in value] if isinstance(value, list) else value


def _decoded(packed: Any, tensors: _Tensors) -> NESState:
    state = _Checkpoint.model_validate({"state": _unpack(packed, tensors)}).state
    if state.generation != len(state.records):
        raise ValueError("its parts do not fit together")
    return state


def _parse(content: bytes) -> tuple[dict[str, Any], _Tensors]:
    """Return header and tensors, whose checksum is right."""
    tensors = safetensors.numpy.load(content)
    size = int.from_bytes(content[:8], "little")
    text = json.loads(content[8 : 8 + size])["__metadata__"]["nes"]
    header = decode_json(dict[str, Any], text, "header")
    if header.pop("sha256", None) != _checksum(header, tensors):
        raise ValueError("its checksum is wrong")
    return header, tensors


def _checksum(header: dict[str, Any], tensors: _Tensors) -> str:
    """Return the checksum of a header and of tensors, including dtypes and shapes."""
    parts = [json.dumps(header).encode()]
    for name in sorted(tensors):
        tensor = tensors[name]
        parts += [f"{name} {tensor.dtype} {tensor.shape}".encode(), tensor.tobytes()]
    return checksum(*parts)
