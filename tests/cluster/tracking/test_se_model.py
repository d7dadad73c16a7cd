"""SEs as models of MLflow."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from bilevel import InvalidInput
from bilevel.synthetic_env import save_se
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import get_task
from cluster.tracking.se_model import SEModel
from tests.ses import make_se


@pytest.mark.parametrize("task_id", ["CartPole-v0", "MountainCarContinuous-v0"])
def test_predictions_equal_the_torch_module(task_id: str, tmp_path: Path) -> None:
    task, rng = get_task(task_id), np.random.default_rng(0)
    se = make_se(task)
    save_se(se, tmp_path / "se.safetensors")
    model = SEModel(tmp_path / "se.safetensors")
    states = rng.normal(size=(5, task.state_size)).astype(np.float32)
    table = pd.DataFrame(states, columns=[f"state_{i}" for i in range(task.state_size)])
    if task.continuous:
        actions: Any = rng.uniform(-1, 1, (5, 1)).astype(np.float32)
        table["action_0"] = actions[:, 0]
    else:
        actions = rng.integers(0, 2, 5)
        table["action"] = actions
    found = model.predict(table)
    expected = SEModule(se)(torch.from_numpy(states), torch.from_numpy(actions))
    np.testing.assert_allclose(found["reward"], expected[1], rtol=1e-5)
    np.testing.assert_allclose(found.filter(like="next_state"), expected[0], rtol=1e-5)
    with pytest.raises(InvalidInput, match="; state_0 is missing"):
        model.predict(table.drop(columns="state_0"))
    if not task.continuous:
        with pytest.raises(InvalidInput, match="action 2 is not allowed"):
            model.predict(table.assign(action=2))
