"""Learned parameters, Adam (Kingma and Ba, 2015) with torch's defaults, and soft target updates."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels.jit import compiled, quotient, square_root

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8

_f = np.float32
_B1, _B2, _C1, _C2 = _f(BETA1), _f(BETA2), _f(1 - BETA1), _f(1 - BETA2)
_EPSILON, _ONE = _f(EPSILON), _f(1)


class Learned(NamedTuple):
    """A parameter vector (P,) with its target, gradient and Adam moments."""

    online: NDArray[np.float32]
    target: NDArray[np.float32]
    gradient: NDArray[np.float32]
    first: NDArray[np.float32]
    second: NDArray[np.float32]


def learned(initial: NDArray[np.float32]) -> Learned:
    """Parameters and targets that start from `initial` (P,)."""
    return Learned(initial, initial.copy(), *(np.zeros_like(initial) for _ in range(3)))


@compiled
def adam_step(learned, step, learning_rate):
    """Make one Adam step in place; `step` counts from 1."""
    params, gradient = learned.online, learned.gradient
    first, second = learned.first, learned.second
    size = _f(learning_rate / (1.0 - BETA1**step))
    inverse = _ONE / _f(np.sqrt(1.0 - BETA2**step))
    for i in range(params.size):
        g = gradient[i]
        m = _B1 * first[i] + _C1 * g
        v = _B2 * second[i] + _C2 * g * g
        first[i] = m
        second[i] = v
        params[i] -= quotient(size * m, square_root(v) * inverse + _EPSILON)


@compiled
def soft_update(learned, rate):
    """target <- (1 - rate) * target + rate * online, in place."""
    target, online = learned.target, learned.online
    for i in range(target.size):
        target[i] += rate * (online[i] - target[i])
