"""SE files: safetensors with a JSON header.

The tensors have torch's names (`reward.0.weight`: network, layer, kind); the header holds task,
architecture, what else a reader must know, hyperparameters, scores and versions (docs/se-files.md).
Reading a file executes no code, and checks names, shapes, types, ranges and a checksum.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat
from safetensors import SafetensorError, safe_open

from bilevel.decode import decode, decode_json
from bilevel.durable import checksum, write_file
from bilevel.errors import InvalidInput, require
from bilevel.hyperparameters import SEHyperparameters
from bilevel.kernels.synthetic_env import DONE
from bilevel.networks import layer_biases, layer_weights
from bilevel.synthetic_env.architecture import NETWORKS, SE, Architecture, Psi
from bilevel.tasks import MAX_STEP_LIMIT, Task, get_task

#: Maximum numbers of state dimensions and actions in a file.
MAX_SPACE = 65536

FORMAT = "bilevel-synthetic-environment"
FORMAT_VERSION = 2


@dataclass(frozen=True)
class StoredSE:
    """An SE with the real task that it replaces.

    `task_id`, `step_limit` and `solved_reward` are those of the real task. `info` is any
    JSON mapping, for instance hyperparameters, scores and versions.
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
        """The real task, on which agents trained on the SE are tested.

        A module that the task's id names must have been imported. Raises InvalidInput if gymnasium
        does not know the task, or its sizes differ from the SE's.
        """
        # gymnasium imports a module that is named in an id: a file must not cause imports.
        module, _, name = self.task_id.rpartition(":")
        known = self.task_id if module in sys.modules else name
        try:
            task = get_task(known, self.solved_reward, self.step_limit)
        except InvalidInput as error:
            if not module or module in sys.modules:
                raise
            raise InvalidInput(
                f"the module {module!r}, which registers the SE's task, is not imported: import "
                f"it first, or, on the command line, give --task {self.task_id}"
            ) from error
        self.architecture.check_fits(task)
        return task


def save_se(se: StoredSE, path: Path | str) -> None:
    """Write an SE file; an existing file is replaced atomically.

    Raises InvalidInput if the folder does not exist, or for an SE that `load_se` would refuse, and
    StorageFailure if the disk is full or cannot be written.
    """
    write_file(Path(path), se_bytes(se))


def se_bytes(se: StoredSE) -> bytes:
    """The content of an SE file; equal SEs give equal bytes. Raises InvalidInput for what no SE
    file can hold: values that are not finite or beyond their ranges, `info` that is not plain."""
    require(StoredSE, se, "an SE", "as `learn` and `load` return it")
    header: dict[str, Any] = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "task": se.task_id,
        "step_limit": _plain(se.step_limit),
        "solved_reward": _plain(se.solved_reward),
        "architecture": asdict(se.architecture),
        "reading": _reading(se.architecture),
        "info": se.info,
    }
    try:
        text = json.dumps(header)
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidInput(f"the info of an SE must be plain values: {error}") from None
    decode(_Header, decode_json(dict[str, Any], text, "SE"), "SE").architecture.checked()
    if json.dumps(json.loads(text)) != text:
        raise InvalidInput("the info of an SE has equal keys: as text, keys must differ")
    if not se.se.finite:
        raise InvalidInput("psi of the SE has values that are not finite")
    header["sha256"] = checksum(text.encode(), se.psi.tobytes())
    # A single entry, because safetensors writes several in random order.
    metadata = {"se": json.dumps(header)}
    return bytes(safetensors.numpy.save(_tensors(se.architecture, se.psi), metadata))


def load_se(path: Path | str) -> StoredSE:
    """Read an SE file.

    Raises InvalidInput if it is missing, damaged, or not an SE file.
    """
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
        raise InvalidInput(f"{str(path)!r} holds tensors of something else than an SE")
    try:
        found = decode_json(dict[str, Any], metadata["se"], "header")
        given = found.pop("sha256", None)  # files of other tools have none
        header = decode(_Header, found, "header")
        architecture = header.architecture.checked()
        _check_reading(header.reading, architecture)
        psi = _flat(architecture, tensors)
        expected = checksum(json.dumps(found).encode(), psi.tobytes())
        if given not in (None, expected):
            raise InvalidInput("its checksum is wrong")
    except InvalidInput as error:
        raise InvalidInput(f"{str(path)!r} is damaged or not an SE file: {error}") from None
    return StoredSE(
        SE(architecture, psi), header.task, header.step_limit, header.solved_reward, header.info
    )


_StepLimit = Annotated[int, Field(ge=1, le=MAX_STEP_LIMIT)]
_Size = Annotated[int, Field(ge=1, le=MAX_SPACE)]


@dataclass(frozen=True)
class _Sizes:
    """The architecture as a header holds it."""

    state_size: _Size
    n_actions: _Size
    hidden_layers: int
    hidden_size: int
    activation: Literal["tanh", "relu", "lrelu", "prelu"]
    step_limit: _StepLimit

    def checked(self) -> Architecture:
        """The architecture of the SE. Raises InvalidInput."""
        SEHyperparameters(
            family="plain",
            hidden_layers=self.hidden_layers,
            hidden_size=self.hidden_size,
            activation=self.activation,
            step_limit=self.step_limit,
            spread=1.0,
        )
        return Architecture(
            self.state_size,
            self.n_actions,
            self.hidden_layers,
            self.hidden_size,
            self.activation,
            self.step_limit,
        )


@dataclass(frozen=True)
class _Header:
    """The header of an SE file."""

    format: Literal["bilevel-synthetic-environment"]
    version: Literal[2]
    task: str
    step_limit: _StepLimit
    solved_reward: FiniteFloat
    architecture: _Sizes
    info: dict[str, Any]
    reading: dict[str, Any] = field(default_factory=dict)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _reading(architecture: Architecture) -> dict[str, Any]:
    """What a reader must know beside the architecture, from which it follows."""
    return {
        "inputs": "one-hot action, then state",
        "slope": architecture.slope,
        "done": DONE,
        "initial_states": "the real task's",
    }


def _check_reading(given: Mapping[str, Any], architecture: Architecture) -> None:
    """Raise InvalidInput where a file of another tool is to be read in another way."""
    for name, ours in _reading(architecture).items():
        if given.get(name, ours) != ours:
            raise InvalidInput(f"reading.{name} must be {ours!r}; got {given[name]!r}")


def _tensors(
    architecture: Architecture, psi: NDArray[np.float32]
) -> dict[str, NDArray[np.float32]]:
    named = {}
    parts = architecture.split(psi)
    for name, net, part in zip(NETWORKS, architecture.networks, parts, strict=True):
        for layer in range(net.sizes.size - 1):
            named[f"{name}.{layer}.weight"] = layer_weights(net, part, layer)
            named[f"{name}.{layer}.bias"] = layer_biases(net, part, layer)
    return named


def _flat(architecture: Architecture, tensors: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
    psi = np.zeros(architecture.parameter_count, np.float32)
    views = _tensors(architecture, psi)
    if tensors.keys() != views.keys():
        raise InvalidInput(f"tensors {sorted(tensors.keys() ^ views.keys())[:3]} do not fit")
    for name, view in views.items():
        tensor = tensors[name]
        if tensor.dtype != np.float32 or tensor.shape != view.shape:
            raise InvalidInput(f"tensor {name} is {tensor.dtype}{list(tensor.shape)}")
        if not np.isfinite(tensor).all():
            raise InvalidInput(f"tensor {name} has values that are not finite")
        view[...] = tensor
    return psi
