"""SE files: safetensors with a JSON header (docs/se-files.md).

Tensors have torch's names (`reward.0.weight`: network, layer, kind). Reading a file executes no
code, and checks names, shapes, types, ranges and a checksum.
"""

import json
import sys
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
from bilevel.networks import layer_biases, layer_weights
from bilevel.synthetic_env.architecture import NETWORKS, SE, Architecture, Psi, StepLimit
from bilevel.tasks import Task, get_task


@dataclass(frozen=True)
class StoredSE:
    """An SE with the id, step limit and solved reward of the real task that it replaces.

    `info` is any JSON mapping, such as hyperparameters, scores and versions.
    """

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
        """Return the real task, on which agents trained on the SE are tested.

        If the task's id names a module (`MODULE:ID`), import the module first: a file must not
        cause imports. Raises InvalidInput if gymnasium does not know the task, or if its sizes
        differ from the SE's.
        """
        module, _, name = self.task_id.rpartition(":")
        imported = not module or module in sys.modules
        try:
            task = get_task(self.task_id if imported else name, self.solved_reward, self.step_limit)
        except InvalidInput as error:
            if imported:
                raise
            raise InvalidInput(
                f"the SE's task is registered by the module {module!r}, which is not imported: "
                f"import it first, or give --task {self.task_id} on the command line"
            ) from error
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
    info: dict[str, Any]

    @classmethod
    def checked(cls, values: Any) -> "_Header":
        """Decode a header. Raises InvalidInput."""
        header = decode(cls, values, "header")
        if header.reading != (expected := _reading(header.architecture)):
            raise InvalidInput(f"reading must be {expected}; got {header.reading}")
        return header


def _reading(architecture: Architecture) -> dict[str, Any]:
    return {
        "inputs": "one-hot action, then state",
        "slope": architecture.slope,
        "done": DONE,
        "initial_states": "the real task's",
    }


def save_se(se: StoredSE, path: Path | str) -> None:
    """Write an SE to a `.safetensors` file, atomically; an existing file is replaced.

    Raises InvalidInput if the folder does not exist, if psi is not finite, or if `info` contains
    other than JSON values, and StorageFailure if the disk cannot be written.
    """
    write_file(Path(path), se_bytes(se))


def se_bytes(se: StoredSE) -> bytes:
    """Return the content of an SE file; equal SEs give equal bytes. Raises InvalidInput as
    `save_se` does."""
    require(StoredSE, se, "an SE", "as `learn` and `load` return it")
    values: dict[str, Any] = {
        "format": "bilevel-synthetic-environment",
        "version": 1,
        "task": se.task_id,
        "step_limit": int(se.step_limit),
        "solved_reward": float(se.solved_reward),
        "architecture": asdict(se.architecture),
        "reading": _reading(se.architecture),
        "info": se.info,
    }
    try:
        header = json.loads(json.dumps(values))  # the values that a reader gets
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidInput(f"the info of an SE must be JSON values: {error}") from None
    _Header.checked(header)
    if not se.se.finite:
        raise InvalidInput("psi of the SE has values that are not finite")
    header["sha256"] = _checksum(header, se.psi)
    # A single metadata entry, because safetensors writes several in random order.
    metadata = {"se": json.dumps(header)}
    return bytes(safetensors.numpy.save(_tensors(se.architecture, se.psi), metadata))


def load_se(path: Path | str) -> StoredSE:
    """Read an SE file. Raises InvalidInput if it is missing, damaged, or not an SE file."""
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError:
        raise InvalidInput(f"no SE file at {str(path)!r}") from None
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        if Path(path).is_dir():
            raise InvalidInput(f"{str(path)!r} is a folder: give an SE file in it") from None
        raise InvalidInput(f"{str(path)!r} is damaged or not an SE file: {error}") from None
    if "se" not in metadata:
        raise InvalidInput(f"{str(path)!r} is a safetensors file, but not of an SE")
    try:
        values = decode_json(dict[str, Any], metadata["se"], "header")
        stored = values.pop("sha256", None)  # other tools need not write a checksum
        header = _Header.checked(values)
        psi = _flat(header.architecture, tensors)
        if stored not in (None, _checksum(values, psi)):
            raise InvalidInput("its checksum is wrong")
    except InvalidInput as error:
        raise InvalidInput(f"{str(path)!r} is damaged or not an SE file: {error}") from None
    return StoredSE(
        SE(header.architecture, psi),
        header.task,
        header.step_limit,
        header.solved_reward,
        header.info,
    )


def _checksum(header: Mapping[str, Any], psi: Psi) -> str:
    return checksum(json.dumps(header).encode(), psi.tobytes())


def _tensors(architecture: Architecture, psi: Psi) -> dict[str, Psi]:
    """Return views of psi by tensor name."""
    tensors = {}
    parts = architecture.split(psi)
    for name, net, part in zip(NETWORKS, architecture.networks, parts, strict=True):
        for layer in range(len(net.shapes)):
            tensors[f"{name}.{layer}.weight"] = layer_weights(net, part, layer)
            tensors[f"{name}.{layer}.bias"] = layer_biases(net, part, layer)
    return tensors


def _flat(architecture: Architecture, tensors: Mapping[str, NDArray[Any]]) -> Psi:
    """Concatenate tensors to psi. Raises InvalidInput for tensors that do not fit."""
    found = sum(tensor.size for tensor in tensors.values())
    if found != architecture.parameter_count:  # before memory is allocated
        raise InvalidInput(f"it has {found} parameters instead of {architecture.parameter_count}")
    psi = np.zeros(architecture.parameter_count, np.float32)
    for name, view in _tensors(architecture, psi).items():
        tensor = tensors.get(name, np.zeros(0))
        if tensor.dtype != np.float32 or tensor.shape != view.shape:
            raise InvalidInput(f"tensor {name} is {tensor.dtype}{list(tensor.shape)}")
        if not np.isfinite(tensor).all():
            raise InvalidInput(f"tensor {name} has values that are not finite")
        view[...] = tensor
    return psi
