"""SplitMix64 (Steele, Lea and Flood, 2014): the generator of the inner loop.

Its state is one counter, so the compiled loop draws in about a nanosecond and the
torch definition draws whole minibatches of the very same numbers with numpy.
"""

import math

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels.jit import compiled

_u = np.uint64
_GAMMA = _u(0x9E3779B97F4A7C15)
_MIX1, _MIX2 = _u(0xBF58476D1CE4E5B9), _u(0x94D049BB133111EB)
_S11, _S27, _S30, _S31, _S32 = _u(11), _u(27), _u(30), _u(31), _u(32)
_UNIT = 2.0**-53


@compiled
def next_uint64(state):
    """The next 64 random bits; `state` (1,) uint64 advances in place."""
    state[0] += _GAMMA
    z = state[0]
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    return z ^ (z >> _S31)


@compiled
def uniform(state):
    """A float64 in [0, 1)."""
    return np.float64(next_uint64(state) >> _S11) * _UNIT


@compiled
def below(state, n):
    """An int64 in [0, n), n < 2**32 (multiply-shift; its bias, n / 2**32, is
    below 3e-5 for the largest replay buffer)."""
    return np.int64(((next_uint64(state) >> _S32) * np.uint64(n)) >> _S32)


@compiled
def gumbel(state):
    """A float32 of the standard Gumbel distribution (one draw)."""
    return np.float32(-math.log(-math.log(max(uniform(state), _UNIT))))


@compiled
def normal(state):
    """A float32 of the standard normal distribution (Box and Muller, two draws)."""
    radius = math.sqrt(-2.0 * math.log(max(uniform(state), _UNIT)))
    return np.float32(radius * math.cos(2.0 * math.pi * uniform(state)))


class SplitMix64:
    """The same generator for Python: draws the same numbers in the same order."""

    def __init__(self, seed: int) -> None:
        self.state = np.array([seed], np.uint64)

    def _bits(self, size: int) -> NDArray[np.uint64]:
        z: NDArray[np.uint64] = self.state + _GAMMA * np.arange(1, size + 1, dtype=np.uint64)
        self.state = z[-1:].copy()
        z = (z ^ (z >> _S30)) * _MIX1
        z = (z ^ (z >> _S27)) * _MIX2
        return z ^ (z >> _S31)

    def _uniforms(self, size: int) -> NDArray[np.float64]:
        return (self._bits(size) >> _S11).astype(np.float64) * _UNIT

    def uniform(self) -> float:
        """A float in [0, 1)."""
        return float(self._uniforms(1)[0])

    def gumbel(self, size: int) -> NDArray[np.float32]:
        """`size` floats of the standard Gumbel distribution."""
        u = np.maximum(self._uniforms(size), _UNIT)
        return (-np.log(-np.log(u))).astype(np.float32)

    def normal(self, size: int) -> NDArray[np.float32]:
        """`size` floats of the standard normal distribution."""
        u = self._uniforms(2 * size).reshape(size, 2)
        radius = np.sqrt(-2.0 * np.log(np.maximum(u[:, 0], _UNIT)))
        return (radius * np.cos(2.0 * np.pi * u[:, 1])).astype(np.float32)

    def below(self, n: int, size: int) -> NDArray[np.int64]:
        """`size` integers in [0, n)."""
        return (((self._bits(size) >> _S32) * _u(n)) >> _S32).astype(np.int64)
