"""Exported SEs equal the torch module."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx.reference
import pytest
import torch

from bilevel.interop import onnx_model, torch_program
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import get_task
from tests.ses import make_se


def assert_equal(found: Any, expected: Any) -> None:
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    ("task_id", "layers", "activation"),
    [
        ("CartPole-v0", 1, "tanh"),
        ("CartPole-v0", 2, "prelu"),
        ("Acrobot-v1", 2, "relu"),
        ("Pendulum-v1", 1, "tanh"),
    ],
)
def test_exports(task_id: str, layers: int, activation: str, tmp_path: Path) -> None:
    se = make_se(get_task(task_id), layers, activation)
    states = np.random.default_rng(0).normal(size=(7, se.architecture.state_size))
    state = torch.tensor(states, dtype=torch.float32)
    action = torch.arange(7) % se.architecture.action_size
    if se.architecture.continuous:
        action = torch.linspace(-1, 1, 7)[:, None]
    expected = SEModule(se)(state, action)

    onnx.save(onnx_model(se), str(tmp_path / "se.onnx"))
    model = onnx.load(str(tmp_path / "se.onnx"))
    inputs = {"state": state.numpy(), "action": action.numpy()}
    run = onnx.reference.ReferenceEvaluator(model).run
    assert_equal(run(["next_state", "reward", "done"], inputs), expected)
    (metadata,) = [json.loads(entry.value) for entry in model.metadata_props if entry.key == "se"]
    assert (metadata["task"], metadata["info"]) == (se.task_id, se.info)

    torch.export.save(torch_program(se), tmp_path / "se.pt2")
    program = torch.export.load(tmp_path / "se.pt2").module()
    assert_equal(program(state, action), expected)
