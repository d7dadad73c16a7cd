"""Replay buffer: a ring of rows (state, next state, reward, done, action).

symbol   meaning
------   ------------------------------------------------------------------
S, M     state size; length of a stored action (1 for an index, A for a vector)
B, B'    batch size; padded to whole vector registers (`mlp.padded`)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels.jit import compiled
from bilevel.kernels.mlp import padded, zeros
from bilevel.kernels.random import below


class Batch(NamedTuple):
    """A minibatch, one sample per column; the padding stays zero. `inputs` is a critic's input."""

    inputs: NDArray[np.float32]  # (S + M, B')
    states: NDArray[np.float32]  # (S, B'), a view of `inputs`
    actions: NDArray[np.float32]  # (M, B'), a view of `inputs`
    next_states: NDArray[np.float32]  # (S, B')
    rewards: NDArray[np.float32]  # (B,)
    dones: NDArray[np.float32]  # (B,) raw outputs


def new_batch(state_size: int, action_size: int, batch_size: int) -> Batch:
    """An empty minibatch."""
    columns = padded(batch_size)
    inputs = zeros(state_size + action_size, columns)
    states, actions, next_states = (
        inputs[:state_size],
        inputs[state_size:],
        zeros(state_size, columns),
    )
    return Batch(inputs, states, actions, next_states, zeros(batch_size), zeros(batch_size))


@compiled
def store(memory, count, state, action, next_state, reward, done):
    """Store transition number `count` (from 0) in `memory` (capacity, 2S + 2 + M); a full buffer
    overwrites its oldest one."""
    row = memory[count % memory.shape[0]]
    n = state.size
    for k in range(n):
        row[k] = state[k]
        row[n + k] = next_state[k]
    row[2 * n] = reward
    row[2 * n + 1] = done
    for k in range(action.size):
        row[2 * n + 2 + k] = action[k]


@compiled
def sample(memory, count, rng, batch):
    """Draw a minibatch with replacement into `batch`."""
    size = min(count, memory.shape[0])
    n = batch.states.shape[0]
    for i in range(batch.rewards.size):
        row = below(rng, size)
        for k in range(n):
            batch.states[k, i] = memory[row, k]
            batch.next_states[k, i] = memory[row, n + k]
        batch.rewards[i] = memory[row, 2 * n]
        batch.dones[i] = memory[row, 2 * n + 1]
        for k in range(batch.actions.shape[0]):
            batch.actions[k, i] = memory[row, 2 * n + 2 + k]
