"""Activations as torch modules."""

from torch import nn


def activation_module(name: str) -> nn.Module:
    """A new torch module for the activation `name`."""
    modules: dict[str, type[nn.Module]] = {
        "tanh": nn.Tanh,
        "relu": nn.ReLU,
        "lrelu": nn.LeakyReLU,
        "prelu": nn.PReLU,
    }
    return modules[name]()
