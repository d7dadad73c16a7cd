"""SplitMix64 (Steele, Lea and Flood, 2014), the random number generator of the inner loop.

Its state is a counter: kernels (`bilevel.kernels.random`) draw a number in a nanosecond, and
definitions draw the same numbers for whole minibatches with numpy.
"""

import numpy as np
from numpy.typing import NDArray

_u = np.uint64
GAMMA = _u(0x9E3779B97F4A7C15)
MIX1, MIX2 = _u(0xBF58476D1CE4E5B9), _u(0x94D049BB133111EB)
S11, S27, S30, S31, S32 = _u(11), _u(27), _u(30), _u(31), _u(32)
UNIT = 2.0**-53


class SplitMix64:
    """The generator in numpy, for the definitions."""

    def __init__(self, seed: int) -> None:
        self.state = np.array([seed], np.uint64)

    def _bits(self, size: int) -> NDArray[np.uint64]:
        z: NDArray[np.uint64] = self.state + GAMMA * np.arange(1, size + 1, dtype=np.uint64)
        self.state = z[-1:].copy()
        z = (z ^ (z >> S30)) * MIX1
        z = (z ^ (z >> S27)) * MIX2
        return z ^ (z >> S31)

    def _uniforms(self, size: int) -> NDArray[np.float64]:
        return (self._bits(size) >> S11).astype(np.float64) * UNIT

    def uniform(self) -> float:
        """A float in [0, 1)."""
        return float(self._uniforms(1)[0])

    def gumbel(self, size: int) -> NDArray[np.float32]:
        """`size` floats of the standard Gumbel distribution."""
        u = np.maximum(self._uniforms(size), UNIT)
        return (-np.log(-np.log(u))).astype(np.float32)

    def normal(self, size: int) -> NDArray[np.float32]:
        """`size` floats of the standard normal distribution."""
        u = self._uniforms(2 * size).reshape(size, 2)
        radius = np.sqrt(-2.0 * np.log(np.maximum(u[:, 0], UNIT)))
        return (radius * np.cos(2.0 * np.pi * u[:, 1])).astype(np.float32)

    def below(self, n: int, size: int) -> NDArray[np.int64]:
        """`size` integers in [0, n)."""
        return (((self._bits(size) >> S32) * _u(n)) >> S32).astype(np.int64)
