"""Networks and replay buffer of the torch definitions."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bilevel.networks import Network
from bilevel.splitmix import SplitMix64
from bilevel.torch_activations import activation_module


class MLP(nn.Module):
    """A network with a copy of `vector`; all hidden layers share one activation module."""

    def __init__(self, net: Network, activation: str, vector: NDArray[np.float32]) -> None:
        super().__init__()
        linear = nn.ModuleList(nn.Linear(n_in, n_out) for n_in, n_out in net.shapes)
        self.layers, self.heads = linear[: -len(net.heads)], linear[-len(net.heads) :]
        self.units = net.heads[:, 0].tolist()  # that each head reads
        self.activation = activation_module(activation)
        set_parameters(self, vector)

    def forward(self, x: Tensor) -> Tensor:
        """Outputs (..., O) of all heads for inputs (..., I)."""
        for layer in self.layers:
            x = self.activation(layer(x))
        parts = zip(self.heads, torch.split(x, self.units, dim=-1), strict=True)
        return torch.cat([head(part) for head, part in parts], dim=-1)


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


class ReplayBuffer:
    """The last `capacity` transitions; an action (M,) is an index or a vector."""

    def __init__(self, capacity: int) -> None:
        self.capacity, self.count = capacity, 0
        self.rows: dict[int, tuple[NDArray[np.float32] | np.float32, ...]] = {}

    def store(
        self,
        state: NDArray[np.float32],
        action: NDArray[np.float32],
        reward: float,
        next_state: NDArray[np.float32],
        done: float,
    ) -> None:
        """Store a transition; a full buffer overwrites its oldest one."""
        row = (state.copy(), action, np.float32(reward), next_state.copy(), np.float32(done))
        self.rows[self.count % self.capacity] = row
        self.count += 1

    def sample(self, size: int, rng: SplitMix64) -> tuple[Tensor, ...]:
        """Draw with replacement: states (B, S), actions (B, M), rewards (B,), next states (B, S),
        raw dones (B,)."""
        drawn = [self.rows[int(i)] for i in rng.below(len(self.rows), size)]
        return tuple(torch.from_numpy(np.array(column)) for column in zip(*drawn, strict=True))
