"""SE files of the paper's code (`.pt`, a pickle that torch writes).

They hold `model`, the state dictionary of the networks `env.state_net`, `env.reward_net` and
`env.done_net`, and `config`, the settings of the run. Only plain values and tensors are read, so
that a file cannot execute code.
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import BaseModel, Field, FiniteFloat

from bilevel.decode import decode
from bilevel.errors import InvalidInput
from bilevel.hyperparameters.agents import Activation
from bilevel.networks import PRELU_INITIAL_SLOPE
from bilevel.synthetic_env import SE, Architecture, Psi, StoredSE
from bilevel.tasks import MAX_STEP_LIMIT, get_task

#: The networks' prefixes in the state dictionary, in the order of psi.
_NETWORKS = ("env.state_net.", "env.reward_net.", "env.done_net.")

_Count = Annotated[int, Field(ge=1)]


class _Settings(BaseModel):
    """The settings that describe the networks, out of many others."""

    solved_reward: FiniteFloat
    max_steps: Annotated[int, Field(ge=1, le=MAX_STEP_LIMIT)]
    activation_fn: Activation
    hidden_size: _Count
    hidden_layer: _Count


def read_paper_se(path: Path | str, task_id: str | None = None) -> StoredSE:
    """Read an SE file of the paper's code.

    `task_id` is the gymnasium id of the task, by default the name in the file. Raises InvalidInput
    for a missing or damaged file, and for an SE that this package cannot represent (layer
    normalisation, a PReLU with a learned slope).
    """
    path = Path(path)
    if not path.is_file():
        raise InvalidInput(f"no file at {str(path)!r}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about pickles of other versions
            content = torch.load(path, map_location="cpu", weights_only=True)
        name = str(content["config"]["env_name"])
        settings = {
            # Searched hyperparameters are lists: lowest value, value, highest.
            key: value[1] if isinstance(value, list) else value
            for key, value in content["config"]["envs"][name].items()
            if key in _Settings.model_fields
        }
        psi = np.concatenate([_flat(content["model"], prefix) for prefix in _NETWORKS])
    except Exception as error:  # torch raises many types
        reason = error if isinstance(error, InvalidInput) else type(error).__name__
        raise InvalidInput(f"{str(path)!r} is no SE of the paper's code: {reason}") from None
    if settings.get("activation_fn") == "leakyrelu":
        settings["activation_fn"] = "lrelu"
    found = decode(_Settings, settings, f"{str(path)!r}, settings of {name}")
    task = get_task(task_id or name)
    sizes = task.state_size, task.n_actions, found.hidden_layer, found.hidden_size
    architecture = Architecture(*sizes, found.activation_fn, found.max_steps)
    info = {"imported_from": path.name}
    se = SE(architecture, psi)
    return StoredSE(se, task.id, task.step_limit, found.solved_reward, info)


def _flat(model: Mapping[str, Any], prefix: str) -> Psi:
    """Concatenate weights and biases of a network. Raises InvalidInput."""
    tensors = []
    for name, tensor in model.items():
        if not name.startswith(prefix):
            continue
        if name.endswith("weight") and tensor.ndim != 2:
            if tensor.numel() == 1 and float(tensor) == PRELU_INITIAL_SLOPE:
                continue
            raise InvalidInput(
                f"{name} belongs to an unsupported layer (layer normalisation, or a PReLU with a "
                "learned slope)"
            )
        tensors.append(tensor.to(torch.float32).flatten())
    return np.asarray(torch.cat(tensors))
