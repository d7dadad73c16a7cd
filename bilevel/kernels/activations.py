"""Activation functions on rows of float32, forwards and backwards.

ReLU, LeakyReLU and PReLU are one function, `max(z, 0) + slope * min(z, 0)`,
with slope 0, 0.01 and a parameter; Tanh is a rational approximation that
vectorises (largest error 5e-7, against the libm call's ten-fold cost).
"""

import numpy as np

from bilevel.kernels.jit import compiled

TANH, RELU, LRELU, PRELU = 0, 1, 2, 3

#: Name -> code, in the spelling of the paper's tables (lower case).
CODES = {"tanh": TANH, "relu": RELU, "lrelu": LRELU, "prelu": PRELU}

#: Slope of LeakyReLU, and the value a PReLU starts from (torch's defaults).
LRELU_SLOPE = 0.01
PRELU_INITIAL_SLOPE = 0.25

_f = np.float32
_ZERO, _ONE = _f(0), _f(1)
_CLAMP = _f(7.90531110763549805)
# Minimax rational approximation of tanh, odd numerator over even denominator,
# in the coefficients of Eigen (Eigen/src/Core/MathFunctionsImpl.h, ptanh_float).
_N1, _N3, _N5 = _f(4.89352455891786e-03), _f(6.37261928875436e-04), _f(1.48572235717979e-05)
_N7, _N9 = _f(5.12229709037114e-08), _f(-8.60467152213735e-11)
_N11, _N13 = _f(2.00018790482477e-13), _f(-2.76076847742355e-16)
_D0, _D2 = _f(4.89352518554385e-03), _f(2.26843463243900e-03)
_D4, _D6 = _f(1.18534705686654e-04), _f(1.19825839466702e-06)


@compiled
def tanh(x):
    """tanh of a float32; NaN stays NaN."""
    x = min(max(x, -_CLAMP), _CLAMP)
    x2 = x * x
    p = _N11 + x2 * _N13
    p = _N9 + x2 * p
    p = _N7 + x2 * p
    p = _N5 + x2 * p
    p = _N3 + x2 * p
    p = _N1 + x2 * p
    q = _D4 + x2 * _D6
    q = _D2 + x2 * q
    q = _D0 + x2 * q
    return x * p / q


@compiled
def activate(z, activation, slope):
    """Replace the matrix `z` by its activations."""
    rows, columns = z.shape
    if activation == TANH:
        for j in range(rows):
            for i in range(columns):
                z[j, i] = tanh(z[j, i])
    elif activation == RELU:
        for j in range(rows):
            for i in range(columns):
                z[j, i] = max(z[j, i], _ZERO)
    else:
        for j in range(rows):
            for i in range(columns):
                z[j, i] = max(z[j, i], _ZERO) + slope * min(z[j, i], _ZERO)


@compiled
def activate_backward(delta, h, z, activation, slope, bias_gradient):
    """Multiply `delta` (gradient of the activations `h`) by the derivative and sum
    its rows into `bias_gradient`; return the gradient of the slope.

    `z` holds the values before activation and is read for PReLU alone: its
    slope may turn negative, so their sign cannot be told from `h`.
    """
    rows, columns = delta.shape
    slope_gradient = _ZERO
    for j in range(rows):
        total = _ZERO
        if activation == TANH:
            for i in range(columns):
                d = delta[j, i] * (_ONE - h[j, i] * h[j, i])
                delta[j, i] = d
                total += d
        elif activation == PRELU:
            for i in range(columns):
                slope_gradient += delta[j, i] * min(z[j, i], _ZERO)
                d = delta[j, i] * (_ONE if z[j, i] > _ZERO else slope)
                delta[j, i] = d
                total += d
        else:
            for i in range(columns):
                d = delta[j, i] * (_ONE if h[j, i] > _ZERO else slope)
                delta[j, i] = d
                total += d
        bias_gradient[j] = total
    return slope_gradient
