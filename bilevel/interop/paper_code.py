"""SE files of the paper's own code (`.pt`, a pickle of torch's).

They hold `model`, the state dictionary of three networks (`env.state_net`, `env.reward_net`,
`env.done_net`), and `config`, the settings of the run. Both are read as plain values and tensors;
a file that holds anything else is refused, so that none of its code runs.
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import BaseModel, Field, FiniteFloat

from bilevel.activations import PRELU_INITIAL_SLOPE
from bilevel.decode import decode
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env import SE, Architecture, StoredSE
from bilevel.tasks import MAX_STEP_LIMIT, get_task

#: Prefixes of the networks' parameters, in the order of psi.
_NETWORKS = ("env.state_net.", "env.reward_net.", "env.done_net.")
#: Names of activations that are other ones here.
_ACTIVATIONS = {"leakyrelu": "lrelu"}


class _Settings(BaseModel):
    """The settings that tell what the networks are; there are many others."""

    solved_reward: FiniteFloat
    max_steps: Annotated[int, Field(ge=1, le=MAX_STEP_LIMIT)]
    activation_fn: str
    hidden_size: Annotated[int, Field(ge=1)]
    hidden_layer: Annotated[int, Field(ge=1)]


def read_paper_se(path: Path | str, task_id: str | None = None) -> StoredSE:
    """Read an SE file of the paper's code; `task_id` is gymnasium's id of the task, by default the
    one that the file names.

    Raises InvalidInput for a file that is missing, damaged, holds something else, or an SE that
    this package cannot represent (layer normalisation, a PReLU whose slope was learned).
    """
    path = Path(path)
    content = _loaded(path)
    try:
        config, model = content["config"], content["model"]
        name = str(config["env_name"])
        settings = config["envs"][name]
        # A list is a range: lowest value, value, highest.
        known = {
            key: settings[key][1] if isinstance(settings[key], list) else settings[key]
            for key in _Settings.model_fields
            if key in settings
        }
        parts = [_flat(path, model, prefix) for prefix in _NETWORKS]
    except (LookupError, TypeError, AttributeError):
        raise InvalidInput(
            f"{str(path)!r} is no SE of the paper's code: it does not hold model and config"
        ) from None
    task = get_task(task_id or name)
    of = decode(_Settings, known, f"{str(path)!r}, settings of {name}")
    hp = SEHyperparameters(
        structure="plain",
        hidden_layers=of.hidden_layer,
        hidden_size=of.hidden_size,
        activation=_ACTIVATIONS.get(of.activation_fn, of.activation_fn),  # type: ignore[arg-type]
        step_limit=of.max_steps,
        spread=1.0,
    )
    architecture = Architecture.of(task, hp)
    psi = np.concatenate(parts)
    if not np.isfinite(psi).all():
        raise InvalidInput(f"{str(path)!r} holds parameters that are not finite")
    if psi.size != architecture.parameter_count:
        raise InvalidInput(
            f"{str(path)!r} holds {psi.size} parameters: an SE of {task.id} with "
            f"{hp.hidden_layers} hidden layer(s) of {hp.hidden_size} units has "
            f"{architecture.parameter_count}"
        )
    info = {"imported_from": path.name}
    return StoredSE(SE(architecture, psi), task.id, task.step_limit, of.solved_reward, info)


def _loaded(path: Path) -> Any:
    """The content of a file of torch's. Raises InvalidInput."""
    if not path.is_file():
        raise InvalidInput(f"no file at {str(path)!r}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about pickles of other versions
            return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises errors of many kinds
        raise InvalidInput(
            f"{str(path)!r} is no SE of the paper's code: {type(error).__name__} when torch read it"
        ) from None


def _flat(path: Path, model: Mapping[str, Any], prefix: str) -> NDArray[np.float32]:
    """Weights and biases of a network, layer by layer. Raises InvalidInput."""
    found = []
    for name, tensor in model.items():
        if not name.startswith(prefix) or not isinstance(tensor, torch.Tensor):
            continue
        if name.endswith("weight") and tensor.ndim != 2:
            if tensor.numel() == 1 and float(tensor) == PRELU_INITIAL_SLOPE:
                continue
            raise InvalidInput(
                f"{str(path)!r}: {name} is of a layer that SEs here do not have (normalisation, or "
                "a PReLU whose slope was learned)"
            )
        found.append(tensor.detach().to(torch.float32).numpy().reshape(-1))
    if not found:
        raise InvalidInput(f"{str(path)!r} holds no {prefix.rstrip('.')}")
    return np.concatenate(found)
