"""Adam (Kingma and Ba, 2015) with torch's defaults, and the soft target update."""

import numpy as np

from bilevel.kernels.jit import compiled, quotient, square_root

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8

_f = np.float32
_B1, _B2, _C1, _C2 = _f(BETA1), _f(BETA2), _f(1 - BETA1), _f(1 - BETA2)
_EPSILON, _ONE = _f(EPSILON), _f(1)


@compiled
def adam_step(params, gradient, first, second, step, learning_rate):
    """One Adam step in place; `step` counts from 1; all arrays are (P,) float32."""
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
def soft_update(target, params, rate):
    """target <- (1 - rate) * target + rate * params, in place."""
    for i in range(target.size):
        target[i] += rate * (params[i] - target[i])
