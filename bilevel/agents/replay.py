"""The replay buffer of the definitions."""

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bilevel.splitmix import SplitMix64

Minibatch = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]


@dataclass
class ReplayBuffer:
    """The last `capacity` transitions; an action (M,) is an index or a vector."""

    capacity: int
    rows: list[tuple[NDArray[np.float32] | np.float32, ...]] = field(default_factory=list)
    count: int = 0

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
        if self.count < self.capacity:
            self.rows.append(row)
        else:
            self.rows[self.count % self.capacity] = row
        self.count += 1

    def sample(self, size: int, rng: SplitMix64) -> Minibatch:
        """Draw with replacement: states (B, S), actions (B, M), rewards (B,), next states (B, S),
        raw dones (B,)."""
        drawn = [self.rows[i] for i in rng.below(len(self.rows), size)]
        columns = [torch.from_numpy(np.array(c)) for c in zip(*drawn, strict=True)]
        states, actions, rewards, next_states, dones = columns
        return states, actions, rewards, next_states, dones
