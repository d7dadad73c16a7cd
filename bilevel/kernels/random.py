"""SplitMix64, compiled: the twin of `bilevel.splitmix`, which draws the same numbers."""

import math

import numpy as np

from bilevel.kernels.jit import compiled
from bilevel.splitmix import GAMMA, MIX1, MIX2, S11, S27, S30, S31, S32, UNIT


@compiled
def next_uint64(state):
    """The next 64 random bits; `state` (1,) uint64 advances in place."""
    state[0] += GAMMA
    z = state[0]
    z = (z ^ (z >> S30)) * MIX1
    z = (z ^ (z >> S27)) * MIX2
    return z ^ (z >> S31)


@compiled
def uniform(state):
    """A float64 in [0, 1)."""
    return np.float64(next_uint64(state) >> S11) * UNIT


@compiled
def below(state, n):
    """An int64 in [0, n), n < 2**32, by multiply-shift; its bias is n / 2**32."""
    return np.int64(((next_uint64(state) >> S32) * np.uint64(n)) >> S32)


@compiled
def gumbel(state):
    """A float32 of the standard Gumbel distribution (one draw)."""
    return np.float32(-math.log(-math.log(max(uniform(state), UNIT))))


@compiled
def normal(state):
    """A float32 of the standard normal distribution (Box and Muller, two draws)."""
    radius = math.sqrt(-2.0 * math.log(max(uniform(state), UNIT)))
    return np.float32(radius * math.cos(2.0 * math.pi * uniform(state)))
