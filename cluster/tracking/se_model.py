"""Loader of registered SEs for MLflow. It reads a safetensors file and no pickle."""

from pathlib import Path

import numpy as np
import pandas as pd
import torch

from bilevel.synthetic_env import load_se
from bilevel.synthetic_env.torch_module import SEModule


class SEModel:
    """Predicts the transitions in a table with the columns `action`, `state_0`, ..."""

    def __init__(self, path: Path) -> None:
        self.module = SEModule(load_se(path))

    def predict(self, table: pd.DataFrame) -> pd.DataFrame:
        """`next_state_0`, ..., `reward` and raw `done`, one row per input row."""
        names = [f"state_{i}" for i in range(self.module.architecture.state_size)]
        states = torch.tensor(table[names].to_numpy(np.float32))
        actions = torch.tensor(table["action"].to_numpy(np.int64))
        next_states, rewards, dones = self.module(states, actions)
        result = pd.DataFrame(next_states.numpy(), columns=[f"next_{name}" for name in names])
        result["reward"], result["done"] = rewards.numpy(), dones.numpy()
        return result


def _load_pyfunc(path: str) -> SEModel:
    return SEModel(Path(path))
