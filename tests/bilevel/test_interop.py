"""Exported SEs equal the torch module."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx.reference
import pytest
import torch

from bilevel.interop import onnx_model, torch_program
from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import get_task
from tests.ses import make_se


@pytest.fixture(
    params=[
        ("CartPole-v0", 1, "tanh"),
        ("CartPole-v0", 2, "prelu"),
        ("Acrobot-v1", 2, "relu"),
        ("Acrobot-v1", 1, "lrelu"),
    ],
    ids=lambda p: "-".join(map(str, p)),
)
def se(request: pytest.FixtureRequest) -> StoredSE:
    """A random SE."""
    name, layers, activation = request.param
    return make_se(get_task(name), layers, activation)


@pytest.fixture
def batch(se: StoredSE) -> dict[str, torch.Tensor]:
    states = np.random.default_rng(0).normal(size=(7, se.architecture.state_size))
    actions = np.arange(7) % se.architecture.n_actions
    return {"state": torch.tensor(states, dtype=torch.float32), "action": torch.tensor(actions)}


def assert_equal(found: Any, expected: Any) -> None:
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-5)


def test_onnx(se: StoredSE, batch: dict[str, torch.Tensor], tmp_path: Path) -> None:
    onnx.save(onnx_model(se), str(tmp_path / "se.onnx"))
    model = onnx.load(str(tmp_path / "se.onnx"))
    inputs = {name: tensor.numpy() for name, tensor in batch.items()}
    run = onnx.reference.ReferenceEvaluator(model).run
    assert_equal(run(["next_state", "reward", "done"], inputs), SEModule(se)(**batch))
    (metadata,) = [json.loads(entry.value) for entry in model.metadata_props if entry.key == "se"]
    assert (metadata["task"], metadata["info"]) == (se.task_id, se.info)
    assert metadata["architecture"] == asdict(se.architecture)


def test_torch_export(se: StoredSE, batch: dict[str, torch.Tensor], tmp_path: Path) -> None:
    torch.export.save(torch_program(se), tmp_path / "se.pt2")
    program = torch.export.load(tmp_path / "se.pt2").module()
    assert_equal(program(*batch.values()), SEModule(se)(**batch))
