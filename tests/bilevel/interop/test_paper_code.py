"""SE files of the paper's own code: built here as that code builds and saves them."""

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
    """One of the three networks; one module for all activations, one for all normalisations."""
    size = settings["hidden_size"]
    active = ACTIVATIONS[settings["activation_fn"]]()
    between = nn.LayerNorm(size) if norm else nn.Identity()
    layers: list[nn.Module] = [nn.Linear(inputs, size), active]
    for _ in range(settings["hidden_layer"] - 1):
        layers += [nn.Linear(size, size), between, active]
    return nn.Sequential(*layers, nn.Linear(size, outputs))


class Saved(nn.Module):
    """What the paper's code saves: an environment within a wrapper."""

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
        "hidden_size": [48, 83, 192],  # as in a file of BOHB's, with the range around it
        "hidden_layer": layers,
        "info_dim": 0,
    }


def chosen(given: dict[str, Any]) -> dict[str, Any]:
    return {**given, "hidden_size": given["hidden_size"][1]}


@pytest.mark.parametrize(("activation", "layers"), [("leakyrelu", 1), ("tanh", 2), ("prelu", 2)])
def test_it_gives_the_same_numbers(activation: str, layers: int, tmp_path: Path) -> None:
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


def test_what_it_cannot_represent_is_refused(tmp_path: Path) -> None:
    normed = Saved(chosen(settings("tanh", 2)), norm=True)
    with pytest.raises(InvalidInput, match="of a layer that SEs here do not have"):
        read_paper_se(normed.write(tmp_path / "se.pt", settings("tanh", 2)))
    linear = Saved(chosen(settings("identity")))
    with pytest.raises(InvalidInput, match=r"activation .identity.: allowed are tanh"):
        read_paper_se(linear.write(tmp_path / "se.pt", settings("identity")))
    other = Saved(chosen(settings()))
    with pytest.raises(InvalidInput, match="parameters: an SE of Acrobot-v1 with 1 hidden"):
        read_paper_se(other.write(tmp_path / "se.pt", settings()), "Acrobot-v1")
    with torch.no_grad():
        next(other.parameters()).fill_(torch.nan)
    with pytest.raises(InvalidInput, match="holds parameters that are not finite"):
        read_paper_se(other.write(tmp_path / "se.pt", settings()))


class Bomb:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


@pytest.mark.parametrize("content", [b"", b"nonsense", pickle.dumps({"config": 1})])
def test_another_file_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "se.pt").write_bytes(content)
    with pytest.raises(InvalidInput, match="is no SE of the paper's code"):
        read_paper_se(tmp_path / "se.pt")
    with pytest.raises(InvalidInput, match="no file at"):
        read_paper_se(tmp_path / "none.pt")


def test_code_in_a_file_does_not_run(tmp_path: Path) -> None:
    torch.save({"model": {}, "config": Bomb(tmp_path / "executed")}, tmp_path / "se.pt")
    with pytest.raises(InvalidInput, match="is no SE of the paper's code"):
        read_paper_se(tmp_path / "se.pt")
    assert not (tmp_path / "executed").exists()
