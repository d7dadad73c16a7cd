"""Activation functions on rows of float32, forward and backward.

ReLU, LeakyReLU and PReLU are one function, `max(z, 0) + slope * min(z, 0)`, with slope 0, 0.01 and
a parameter. Tanh is a rational approximation that vectorises (largest error 5e-7); a libm call
would cost ten times as much.
"""

import numpy as np

from bilevel.kernels.jit import compiled, quotient
from bilevel.networks import PRELU, RELU, TANH

_f = np.float32
_ZERO, _ONE = _f(0), _f(1)
_CLAMP = _f(8)
# tanh(x) = x * P(x^2) / Q(x^2) on [-8, 8]: the minimax rational function of these degrees (error
# 1.2e-7 before rounding), found by linear programming.
_P0, _P1, _P2, _P3 = _f(0.9999994), _f(0.1290962), _f(2.9346335e-3), _f(1.1268122e-5)
_Q1, _Q2, _Q3, _Q4 = _f(0.4624271), _f(0.023746315), _f(2.364543e-4), _f(2.411031e-7)


@compiled
def tanh(x):
    """tanh of a float32; NaN stays NaN."""
    x = min(max(x, -_CLAMP), _CLAMP)
    x2 = x * x
    p = _P0 + x2 * (_P1 + x2 * (_P2 + x2 * _P3))
    q = _ONE + x2 * (_Q1 + x2 * (_Q2 + x2 * (_Q3 + x2 * _Q4)))
    return quotient(x * p, q)


@compiled
def activate(z, bias, activation, slope):
    """Replace the vector `z` by the activations of z + bias."""
    if activation == TANH:
        for i in range(z.size):
            z[i] = tanh(z[i] + bias)
    elif activation == RELU:
        for i in range(z.size):
            z[i] = max(z[i] + bias, _ZERO)
    else:
        for i in range(z.size):
            x = z[i] + bias
            z[i] = max(x, _ZERO) + slope * min(x, _ZERO)


@compiled
def activate_rows(h, z, biases, activation, slope):
    """Replace every row of `h` by the activations of its values plus its bias, and, for PReLU,
    store the values before activation in `z`."""
    for j in range(h.shape[0]):
        row, bias = h[j], biases[j]
        if activation == PRELU:
            for i in range(row.size):
                z[j, i] = row[i] + bias
        activate(row, bias, activation, slope)


@compiled
def activate_rows_backward(delta, h, z, activation, slope, bias_gradient):
    """Multiply `delta` (gradient of the activations `h`) by the derivative, write the sums of its
    rows into `bias_gradient`, and return the gradient of the slope. A PReLU needs the values `z`
    before activation, because its slope may become negative."""
    rows, columns = delta.shape
    slope_gradient = _ZERO
    for j in range(rows):
        if activation == TANH:
            for i in range(columns):
                delta[j, i] *= _ONE - h[j, i] * h[j, i]
        elif activation == PRELU:
            for i in range(columns):
                slope_gradient += delta[j, i] * min(z[j, i], _ZERO)
                delta[j, i] *= _ONE if z[j, i] > _ZERO else slope
        else:
            for i in range(columns):
                delta[j, i] *= _ONE if h[j, i] > _ZERO else slope
        total = _ZERO
        for i in range(columns):
            total += delta[j, i]
        bias_gradient[j] = total
    return slope_gradient
