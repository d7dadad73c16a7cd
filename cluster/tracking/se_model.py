"""Loader of registered SEs for MLflow. It reads a safetensors file and no pickle."""

from pathlib import Path

import numpy as np
import pandas as pd
import torch

from bilevel.errors import InvalidInput
from bilevel.spaces import checked_index
from bilevel.synthetic_env import load_se
from bilevel.synthetic_env.torch_module import SEModule


class SEModel:
    """Predicts the transitions in a table with the columns `state_0`, ... and `action`, or
    `action_0`, ... for continuous actions."""

    def __init__(self, path: Path) -> None:
        self.se = load_se(path)
        self.module = SEModule(self.se)

    def predict(self, table: pd.DataFrame) -> pd.DataFrame:
        """`next_state_0`, ..., `reward` and raw `done`, one row per input row."""
        arch, of_actions = self.se.architecture, ["action"]
        names = [f"state_{i}" for i in range(arch.state_size)]
        if arch.continuous:
            of_actions = [f"action_{i}" for i in range(arch.action_size)]
        missing = [name for name in [*names, *of_actions] if name not in table]
        if missing:
            raise InvalidInput(
                f"an SE for {self.se.task_id} predicts from the columns "
                f"{', '.join(names + of_actions)}; {', '.join(missing)} is missing"
            )
        states = torch.tensor(table[names].to_numpy(np.float32))
        if arch.continuous:
            actions = torch.tensor(table[of_actions].to_numpy(np.float32))
        else:
            actions = torch.tensor(table["action"].to_numpy(np.int64))
            for extreme in {int(actions.min()), int(actions.max())} if len(actions) else ():
                checked_index(extreme, arch.action_size)
        next_states, rewards, dones = self.module(states, actions)
        result = pd.DataFrame(next_states.numpy(), columns=[f"next_{name}" for name in names])
        result["reward"], result["done"] = rewards.numpy(), dones.numpy()
        return result


def _load_pyfunc(path: str) -> SEModel:
    return SEModel(Path(path))
