"""Exported SEs give the same numbers as the SE."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import onnx
import onnx.reference
import pytest
import torch

from bilevel.hyperparameters import load_recipe
from bilevel.interop.onnx import onnx_model
from bilevel.interop.torch_program import torch_program
from bilevel.synthetic_env import SE, Architecture, StoredSE
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import get_task

ROWS = 7


@pytest.fixture(
    params=[
        ("CartPole-v0", "tanh", 1),
        ("CartPole-v0", "prelu", 2),
        ("Acrobot-v1", "relu", 2),
        ("Acrobot-v1", "lrelu", 1),
    ],
    ids=lambda p: "-".join(map(str, p)),
)
def se(request: pytest.FixtureRequest) -> StoredSE:
    """A random SE."""
    name, activation, layers = request.param
    task = get_task(name)
    plain = load_recipe("paper", task.id).se
    hp = replace(plain, activation=activation, hidden_layers=layers, hidden_size=9)
    architecture = Architecture.of(task, hp)
    psi = architecture.initialize(np.random.default_rng(3))
    return StoredSE(SE(architecture, psi), task.id, task.step_limit, task.solved_reward, {"a": 1})


def asked(se: StoredSE) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    states = rng.normal(size=(ROWS, se.architecture.state_size)).astype(np.float32)
    return states, np.arange(ROWS) % se.architecture.n_actions


def expected(se: StoredSE) -> list[np.ndarray]:
    states, actions = asked(se)
    return [t.numpy() for t in SEModule(se)(torch.from_numpy(states), torch.from_numpy(actions))]


def test_onnx(se: StoredSE, tmp_path: Path) -> None:
    onnx.save(onnx_model(se), str(tmp_path / "se.onnx"))
    model = onnx.load(str(tmp_path / "se.onnx"))
    states, actions = asked(se)
    found = onnx.reference.ReferenceEvaluator(model).run(
        ["next_state", "reward", "done"], {"state": states, "action": actions}
    )
    for one, other in zip(found, expected(se), strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-5)
    (told,) = [entry.value for entry in model.metadata_props if entry.key == "se"]
    facts = json.loads(told)  # as in the header of an SE file
    assert (facts["task"], facts["step_limit"]) == (se.task_id, se.step_limit)
    assert facts["architecture"] == asdict(se.architecture)


def test_torch_export(se: StoredSE, tmp_path: Path) -> None:
    torch.export.save(torch_program(se), tmp_path / "se.pt2")
    program = torch.export.load(tmp_path / "se.pt2").module()
    states, actions = asked(se)
    found = program(torch.from_numpy(states), torch.from_numpy(actions))
    for one, other in zip(found, expected(se), strict=True):
        np.testing.assert_allclose(one.numpy(), other, rtol=1e-4, atol=1e-5)
