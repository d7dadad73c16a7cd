"""Compiled environments that agents train on: an SE, or a real task's dynamics.

Actions are indices, or vectors (M,) in [-1, 1].
"""

from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from bilevel.kernels import dynamics, synthetic_env
from bilevel.kernels.jit import OPTIONS, compiled
from bilevel.kernels.synthetic_env import SEKernel


class Environment(NamedTuple):
    """An SE or a real task."""

    synthetic: bool
    se: SEKernel  # read only if synthetic
    dynamics: int  # code of `bilevel.kernels.dynamics`
    state_size: int
    step_limit: int
    solved_reward: float  # read only if not synthetic
    initial_physics: NDArray[np.float64]  # (rows, p); episode e starts in row e mod rows
    physics: NDArray[np.float64]  # (p,) of the current episode
    work: NDArray[np.float32]  # (2, 3H), a `work_space` of the SE


@compiled
def reset(env, episode, state):
    """Start an episode and write its initial state into `state` (S,)."""
    env.physics[:] = env.initial_physics[episode % env.initial_physics.shape[0]]
    dynamics.observe(env.dynamics, env.physics, state)


def scalar(action):
    """The action as a float: all compiled tasks have one action dimension."""


@overload(scalar, jit_options=OPTIONS, strict=False)
def _scalar(action):
    if isinstance(action, types.Array):
        return lambda action: float(action[0])
    return lambda action: float(action)


@compiled
def step(env, state, action, next_state):
    """Write the next state into `next_state` (S,); return the reward, the raw done output (0 or 1
    for a real task) and True at the end of the episode."""
    if env.synthetic:
        reward, done = synthetic_env.step(env.se, state, action, next_state, env.work)
        return reward, done, done > synthetic_env.DONE
    real_reward, over = dynamics.step(env.dynamics, env.physics, scalar(action))
    dynamics.observe(env.dynamics, env.physics, next_state)
    return np.float32(real_reward), np.float32(1) if over else np.float32(0), over
