"""A multilayer perceptron on a flat float32 parameter vector (`bilevel.networks`).

symbol   shape              meaning
------   ----------------   ------------------------------------------------
depth    -                  number of hidden layers
H        -                  width of every hidden layer
B'       -                  batch size, padded to whole tiles
x        (inputs, B')       inputs, one *column* per sample
h        (depth, H, B')     hidden activations
z        (depth, H, B')     values before activation (only PReLU reads them)
y        (outputs, B')      outputs, the heads one below the other

Columns are samples, so that every loop runs along the batch, in vector registers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel import networks
from bilevel.kernels.activations import activate, activate_rows, activate_rows_backward
from bilevel.kernels.jit import compiled
from bilevel.kernels.products import product
from bilevel.kernels.tiles import LANES
from bilevel.networks import LRELU, LRELU_SLOPE, PRELU, Network

_ZERO = np.float32(0)
_LRELU_SLOPE = np.float32(LRELU_SLOPE)

#: Compiled versions of the functions in `bilevel.networks`.
layer_weights = compiled(networks.layer_weights)
layer_biases = compiled(networks.layer_biases)


class Work(NamedTuple):
    """Memory for the hidden layers of a network."""

    h: NDArray[np.float32]  # (depth, H, B')
    z: NDArray[np.float32]  # (depth, H, B')
    delta_h: NDArray[np.float32]  # (depth, H, B') gradient of h
    single: NDArray[np.float32]  # (2, H) layers of a single sample, in turn


def zeros(*shape: int) -> NDArray[np.float32]:
    """A float32 array of zeros."""
    return np.zeros(shape, np.float32)


def padded(batch_size: int) -> int:
    """The batch size, rounded up to whole tiles, so that no loop ends with single samples."""
    return -(-batch_size // LANES) * LANES


def work_space(net: Network, batch_size: int) -> Work:
    """Memory for batches of that size, which is padded."""
    depth, hidden = net.sizes.size - 2, int(net.sizes[1])
    h, z, delta_h = (zeros(depth, hidden, padded(batch_size)) for _ in range(3))
    return Work(h, z, delta_h, single=zeros(2, hidden))


@compiled
def forward(net, params, x, work, y):
    """Write the outputs for a batch into `y`, and the hidden layers into `work`."""
    slope = _negative_slope(net, params)
    depth = net.sizes.size - 2
    inputs = x
    for layer in range(depth):
        h, z = work.h[layer], work.z[layer]
        product(layer_weights(net, params, layer), inputs, h)
        activate_rows(h, z, layer_biases(net, params, layer), net.activation, slope)
        inputs = h
    for head in range(net.heads.shape[0]):
        unit, last_unit, output, last_output = _head(net, head)
        biases = layer_biases(net, params, depth + head)
        out = y[output:last_output]
        product(layer_weights(net, params, depth + head), inputs[unit:last_unit], out)
        for a in range(out.shape[0]):
            bias = biases[a]
            for i in range(out.shape[1]):
                out[a, i] += bias


@compiled
def backward(net, params, x, work, delta_y, gradient):
    """Write the gradient of all parameters into `gradient`, given that of the outputs, `delta_y`
    (outputs, B')."""
    depth = net.sizes.size - 2
    for head in range(net.heads.shape[0]):
        unit, last_unit, output, last_output = _head(net, head)
        delta = delta_y[output:last_output]
        top = work.h[depth - 1][unit:last_unit]
        product(delta, top.T, layer_weights(net, gradient, depth + head))
        bias_gradient = layer_biases(net, gradient, depth + head)
        for a in range(delta.shape[0]):
            total = _ZERO
            for i in range(delta.shape[1]):
                total += delta[a, i]
            bias_gradient[a] = total
    propagate(net, params, work, delta_y, gradient)
    for layer in range(depth):
        inputs = work.h[layer - 1] if layer > 0 else x
        product(work.delta_h[layer], inputs.T, layer_weights(net, gradient, layer))


@compiled
def propagate(net, params, work, delta_y, gradient):
    """Compute the part of `backward` that passes down the layers: the gradients of hidden layers
    (in `work`), of their biases and of the slope."""
    slope = _negative_slope(net, params)
    slope_gradient = _ZERO
    depth = net.sizes.size - 2
    delta_h = work.delta_h
    for head in range(net.heads.shape[0]):
        unit, last_unit, output, last_output = _head(net, head)
        weights = layer_weights(net, params, depth + head)
        product(weights.T, delta_y[output:last_output], delta_h[depth - 1][unit:last_unit])
    for layer in range(depth - 1, -1, -1):
        if layer < depth - 1:
            product(layer_weights(net, params, layer + 1).T, delta_h[layer + 1], delta_h[layer])
        bias_gradient = layer_biases(net, gradient, layer)
        slope_gradient += activate_rows_backward(
            delta_h[layer], work.h[layer], work.z[layer], net.activation, slope, bias_gradient
        )
    if net.activation == PRELU:
        gradient[gradient.size - 1] = slope_gradient


@compiled
def forward_single(net, params, x, work, y):
    """Write the outputs for one sample `x` (inputs,) into `y` (outputs,)."""
    slope = _negative_slope(net, params)
    depth = net.sizes.size - 2
    inputs = x
    for layer in range(depth):
        out = work.single[layer % 2]
        weights = layer_weights(net, params, layer)
        _affine(weights, layer_biases(net, params, layer), inputs, out)
        activate(out, _ZERO, net.activation, slope)
        inputs = out
    for head in range(net.heads.shape[0]):
        unit, last_unit, output, last_output = _head(net, head)
        weights = layer_weights(net, params, depth + head)
        biases = layer_biases(net, params, depth + head)
        _affine(weights, biases, inputs[unit:last_unit], y[output:last_output])


@compiled
def _head(net, head):
    """The hidden units that a head reads, and its outputs, as bounds of two slices."""
    unit = output = 0
    for earlier in range(head):
        unit += net.heads[earlier, 0]
        output += net.heads[earlier, 1]
    return unit, unit + net.heads[head, 0], output, output + net.heads[head, 1]


@compiled
def _negative_slope(net, params):
    """Slope of the activation for negative inputs."""
    if net.activation == PRELU:
        return params[params.size - 1]
    return _LRELU_SLOPE if net.activation == LRELU else _ZERO


@compiled
def _affine(weights, biases, x, out):
    for j in range(weights.shape[0]):
        total = biases[j]
        for k in range(weights.shape[1]):
            total += weights[j, k] * x[k]
        out[j] = total
