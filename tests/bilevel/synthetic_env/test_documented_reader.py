"""The reader of SE files in docs/se-files.md gives what the package gives."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bilevel.hyperparameters import ACTIVATIONS, SEHyperparameters
from bilevel.synthetic_env import SE, Architecture, StoredSE, save_se
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import get_task
from tests.documents import documented_code


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("layers", [1, 2])
def test_the_documented_reader(
    activation: Any, layers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = get_task("Acrobot-v1")
    hp = SEHyperparameters(
        structure="plain",
        hidden_layers=layers,
        hidden_size=9,
        activation=activation,
        step_limit=30,
    )
    architecture, rng = Architecture.of(task, hp), np.random.default_rng(0)
    se = StoredSE(SE(architecture, 2 * architecture.initialize(rng)), task.id, 500, -100.0)
    save_se(se, tmp_path / "best_se.safetensors")
    monkeypatch.chdir(tmp_path)
    code: dict[str, Any] = {}
    exec(documented_code("se-files.md"), code)
    states = rng.standard_normal((40, task.state_size)).astype(np.float32)
    actions = rng.integers(task.n_actions, size=40)
    expected = SEModule(se)(torch.from_numpy(states), torch.from_numpy(actions))
    found = [code["step"](s, a) for s, a in zip(states, actions, strict=True)]
    for i, output in enumerate(expected[:2]):
        np.testing.assert_allclose(np.array([f[i] for f in found]), output, rtol=1e-3, atol=1e-4)
    clear = np.abs(expected[2].numpy() - 0.5) > 1e-3
    ends = np.array([f[2] for f in found])
    np.testing.assert_array_equal(ends[clear], expected[2].numpy()[clear] > 0.5)
