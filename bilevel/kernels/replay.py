"""Replay buffer: a ring of rows (state, next state, reward, done, action)."""

import numpy as np

from bilevel.kernels.jit import compiled
from bilevel.kernels.random import below


@compiled
def store(memory, count, state, action, next_state, reward, done):
    """Write transition number `count` (from 0); the oldest one gives way.

    `memory` is (capacity, 2S + 3) float32; `done` is the raw output, a float.
    """
    row = memory[count % memory.shape[0]]
    n = state.size
    for k in range(n):
        row[k] = state[k]
        row[n + k] = next_state[k]
    row[2 * n] = reward
    row[2 * n + 1] = done
    row[2 * n + 2] = action


@compiled
def sample(memory, count, rng, states, next_states, rewards, dones, actions):
    """Draw a minibatch with replacement, one column a sample: rewards and dones
    (B,) float32, actions (B,) int64, states and next states (S, at least B) float32."""
    size = min(count, memory.shape[0])
    n = states.shape[0]
    for i in range(rewards.size):
        row = below(rng, size)
        for k in range(n):
            states[k, i] = memory[row, k]
            next_states[k, i] = memory[row, n + k]
        rewards[i] = memory[row, 2 * n]
        dones[i] = memory[row, 2 * n + 1]
        actions[i] = np.int64(memory[row, 2 * n + 2])
