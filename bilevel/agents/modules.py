"""Networks of the torch definitions."""

from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bilevel.torch_activations import activation_module


class MLP(nn.Module):
    """Hidden layers and a linear output; all hidden layers share one activation module, and so one
    PReLU slope."""

    def __init__(self, n_in: int, n_out: int, size: int, depth: int, activation: str) -> None:
        super().__init__()
        sizes = [n_in, *[size] * depth, n_out]
        self.layers = nn.ModuleList(nn.Linear(n, m) for n, m in pairwise(sizes))
        self.activation = activation_module(activation)

    def forward(self, x: Tensor) -> Tensor:
        """Outputs (..., n_out) for inputs (..., n_in)."""
        for layer in self.layers[:-1]:
            x = self.activation(layer(x))
        outputs: Tensor = self.layers[-1](x)
        return outputs


def set_parameters(module: nn.Module, vector: NDArray[np.float32]) -> None:
    """Copy a flat vector into a module's parameters."""
    nn.utils.vector_to_parameters(torch.from_numpy(vector.copy()), module.parameters())


def flat_parameters(module: nn.Module) -> NDArray[np.float32]:
    """A module's parameters as a flat vector."""
    return nn.utils.parameters_to_vector(module.parameters()).detach().numpy()


def soft_update(target: nn.Module, online: nn.Module, rate: float) -> None:
    """target <- target + rate * (online - target)."""
    with torch.no_grad():
        for old, new in zip(target.parameters(), online.parameters(), strict=True):
            old.lerp_(new, rate)
