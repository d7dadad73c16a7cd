"""Import of SE files of the paper's code, which are built here as that code builds them."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from bilevel import InvalidInput
from bilevel.interop.paper_code import read_paper_se
from bilevel.synthetic_env.torch_module import SEModule

ACTIVATIONS = {
    "leakyrelu": nn.LeakyReLU,
    "tanh": nn.Tanh,
    "relu": nn.ReLU,
    "prelu": nn.PReLU,
    "identity": nn.Identity,
}


def network(inputs: int, outputs: int, settings: dict[str, Any], norm: bool) -> nn.Sequential:
    """One of the three networks; all layers share the activation and normalisation modules."""
    size = settings["hidden_size"]
    active = ACTIVATIONS[settings["activation_fn"]]()
    between = nn.LayerNorm(size) if norm else nn.Identity()
    layers: list[nn.Module] = [nn.Linear(inputs, size), active]
    for _ in range(settings["hidden_layer"] - 1):
        layers += [nn.Linear(size, size), between, active]
    return nn.Sequential(*layers, nn.Linear(size, outputs))


class Saved(nn.Module):
    """The module that the paper's code saves: an environment in a wrapper."""

    def __init__(self, settings: dict[str, Any], norm: bool = False) -> None:
        super().__init__()
        self.env = nn.Module()
        self.env.state_net = network(6, 4, settings, norm)
        self.env.reward_net = network(6, 1, settings, norm)
        self.env.done_net = network(6, 1, settings, norm)

    def write(self, path: Path, settings: dict[str, Any], name: str = "CartPole-v0") -> Path:
        config = {"env_name": name, "device": "cpu", "agents": {}, "envs": {name: settings}}
        torch.save({"model": self.state_dict(), "config": config}, path)
        return path


def settings(activation: str = "leakyrelu", layers: int = 1) -> dict[str, Any]:
    return {
        "solved_reward": 195.0,
        "max_steps": 200,
        "activation_fn": activation,
        "hidden_size": [48, 83, 192],  # searched: lowest value, value, highest
        "hidden_layer": layers,
        "info_dim": 0,
    }


def chosen(given: dict[str, Any]) -> dict[str, Any]:
    return {**given, "hidden_size": given["hidden_size"][1]}


@pytest.mark.parametrize(("activation", "layers"), [("leakyrelu", 1), ("tanh", 2), ("prelu", 2)])
def test_outputs_equal_the_original(activation: str, layers: int, tmp_path: Path) -> None:
    given = settings(activation, layers)
    torch.manual_seed(0)
    theirs = Saved(chosen(given))
    se = read_paper_se(theirs.write(tmp_path / "se.pt", given))
    assert (se.task_id, se.solved_reward, se.architecture.step_limit) == ("CartPole-v0", 195, 200)
    states, actions = torch.randn(5, 4), torch.tensor([0, 1, 1, 0, 1])
    inputs = torch.cat([nn.functional.one_hot(actions, 2), states], dim=1)
    nets = (theirs.env.state_net, theirs.env.reward_net, theirs.env.done_net)
    for ours, net in zip(SEModule(se)(states, actions), nets, strict=True):
        expected = net(inputs).detach().numpy()  # type: ignore[operator]
        np.testing.assert_allclose(
            ours.numpy().reshape(expected.shape), expected, rtol=1e-4, atol=1e-5
        )


@pytest.mark.parametrize(
    ("activation", "layers", "norm", "task", "message"),
    [
        ("tanh", 2, True, None, "belongs to an unsupported layer"),
        ("identity", 1, False, None, "activation_fn: must be 'tanh', 'relu'.*; got 'identity'"),
        ("leakyrelu", 1, False, "Acrobot-v1", "psi has shape .* networks have"),
    ],
)
def test_unsupported_networks(
    activation: str, layers: int, norm: bool, task: str | None, message: str, tmp_path: Path
) -> None:
    given = settings(activation, layers)
    file = Saved(chosen(given), norm).write(tmp_path / "se.pt", given)
    with pytest.raises(InvalidInput, match=message):
        read_paper_se(file, task)


def test_a_learned_slope_is_unsupported(tmp_path: Path) -> None:
    saved = Saved(chosen(settings("prelu")))
    with torch.no_grad():
        next(p for p in saved.parameters() if p.numel() == 1).fill_(0.3)
    with pytest.raises(InvalidInput, match="a PReLU with a learned slope"):
        read_paper_se(saved.write(tmp_path / "se.pt", settings("prelu")))


class Bomb:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


@pytest.mark.parametrize("content", [b"", b"nonsense", pickle.dumps({"config": 1}), None])
def test_other_files(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "se.pt"
    with pytest.raises(InvalidInput, match="no file at"):
        read_paper_se(path)
    if content is None:
        torch.save({"model": {}, "config": Bomb(tmp_path / "executed")}, path)
    else:
        path.write_bytes(content)
    with pytest.raises(InvalidInput, match="is no SE of the paper's code"):
        read_paper_se(path)
    assert not (tmp_path / "executed").exists()
