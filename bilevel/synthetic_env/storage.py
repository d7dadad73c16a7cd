"""SE files: safetensors with a JSON header (docs/se-files.md).

Tensors have torch's names (`reward.0.weight`: network, layer, kind). Reading a file executes no
code, and checks names, shapes, types, ranges and a checksum.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from pydantic import FiniteFloat
from safetensors import SafetensorError, safe_open

from bilevel.decode import decode, decode_json
from bilevel.durable import checksum, write_file
from bilevel.errors import InvalidInput, require
from bilevel.kernels.synthetic_env import DONE
from bilevel.synthetic_env.architecture import SE, Architecture, Psi, StepLimit
from bilevel.tasks import EnvSource, Task, get_task


@dataclass(frozen=True)
class StoredSE:
    """An SE, with the id, step limit and solved reward of the real task that it replaces, and any
    other JSON values (`info`), such as hyperparameters and scores."""

    se: SE
    task_id: str
    step_limit: int
    solved_reward: float
    info: Mapping[str, Any] = field(default_factory=dict)

    @property
    def architecture(self) -> Architecture:
        """The SE's architecture."""
        return self.se.architecture

    @property
    def psi(self) -> Psi:
        """The SE's parameters (P,)."""
        return self.se.psi

    def task(self) -> Task:
        """Return the real task, on which agents trained on the SE are tested. Raises InvalidInput
        if gymnasium does not know the task, if it does not fit, or if its id names a module
        (`MODULE:ID`) that is not imported."""
        for module in EnvSource.parse(self.task_id).missing_modules:  # files cause no imports
            raise InvalidInput(
                f"the SE's task needs the module {module!r}, which is not imported: import it "
                f"first, or give --task {self.task_id} on the command line"
            )
        task = get_task(self.task_id, self.solved_reward, self.step_limit)
        self.architecture.check_fits(task)
        return task


@dataclass(frozen=True)
class _Header:
    """Header of an SE file, without the checksum."""

    format: Literal["bilevel-synthetic-environment"]
    version: Literal[1]
    task: str
    step_limit: StepLimit
    solved_reward: FiniteFloat
    architecture: Architecture
    reading: dict[str, Any]  # constants that readers need in addition to the architecture
    info: Mapping[str, Any]


def _checked(values: Any) -> _Header:
    """Decode a header. Raises InvalidInput."""
    header = decode(_Header, values, "header")
    if header.reading != (expected := _reading(header.architecture)):
        raise InvalidInput(f"reading must be {expected}; got {header.reading}")
    return header


def _reading(architecture: Architecture) -> dict[str, Any]:
    learned = architecture.own_initial_states
    return {
        "inputs": f"{'action' if architecture.continuous else 'one-hot action'}, then state",
        "slope": architecture.slope,
        "done": DONE,
        "initial_states": "initial_state(z), z ~ N(0, I)" if learned else "the real task's",
    }


def header_of(se: StoredSE) -> dict[str, Any]:
    """Return the header of an SE's file, without its checksum. Raises InvalidInput."""
    header = {
        "format": "bilevel-synthetic-environment",
        "version": 1,
        "task": se.task_id,
        "step_limit": se.step_limit,
        "solved_reward": se.solved_reward,
        "architecture": asdict(se.architecture),
        "reading": _reading(se.architecture),
        "info": dict(se.info),
    }
    _checked(header)
    return header


def save_se(se: StoredSE, path: Path | str) -> None:
    """Write an SE to a `.safetensors` file, atomically. Raises InvalidInput if psi is not finite or
    `info` contains other than JSON values, and StorageFailure if the file cannot be written."""
    write_file(Path(path), se_bytes(se))


def se_bytes(se: StoredSE) -> bytes:
    """Return the content of an SE file; equal SEs give equal bytes. Raises InvalidInput."""
    require(StoredSE, se, "an SE", "as `learn` and `load` return it")
    header = header_of(se)
    if not se.se.finite:
        raise InvalidInput("psi has values that are not finite")
    header["sha256"] = _checksum(header, se.psi)
    # A single metadata entry, because safetensors writes several in random order.
    metadata = {"se": json.dumps(header)}
    return bytes(safetensors.numpy.save(se.architecture.tensors(se.psi), metadata))


def load_se(path: Path | str) -> StoredSE:
    """Read an SE file. Raises InvalidInput if it is missing, damaged, or not an SE file."""
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        values = decode_json(dict[str, Any], metadata.get("se", ""), "header")
        stored = values.pop("sha256", None)  # other tools need not write a checksum
        header = _checked(values)
        psi = _flat(header.architecture, tensors)
        if stored not in (None, _checksum(values, psi)):
            raise InvalidInput("its checksum is wrong")
    except FileNotFoundError:
        raise InvalidInput(f"no SE file at {str(path)!r}") from None
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        raise InvalidInput(f"{str(path)!r} is damaged or not an SE file: {error}") from None
    se = SE(header.architecture, psi)
    return StoredSE(se, header.task, header.step_limit, header.solved_reward, header.info)


def _checksum(header: Mapping[str, Any], psi: Psi) -> str:
    return checksum(json.dumps(header).encode(), psi.tobytes())


def _flat(architecture: Architecture, tensors: Mapping[str, NDArray[Any]]) -> Psi:
    """Concatenate tensors to psi. Raises InvalidInput for tensors that do not fit."""
    if sum(tensor.size for tensor in tensors.values()) != architecture.parameter_count:
        raise InvalidInput("the number of its parameters does not fit its architecture")
    psi = np.zeros(architecture.parameter_count, np.float32)
    for name, view in architecture.tensors(psi).items():
        tensor = tensors.get(name)
        if tensor is None or tensor.dtype != np.float32 or tensor.shape != view.shape:
            raise InvalidInput(f"tensor {name} must be float32{list(view.shape)}")
        view[...] = tensor
    if not np.isfinite(psi).all():
        raise InvalidInput("psi has values that are not finite")
    return psi
