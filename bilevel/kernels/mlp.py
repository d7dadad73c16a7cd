"""A multilayer perceptron on a flat float32 parameter vector.

The vector lies as torch's `parameters_to_vector` lays it: per layer the weights
(outputs x inputs, row-major), then the biases; last, for PReLU, the one slope
that all hidden layers of the network share.

symbol   shape              meaning
------   ----------------   ------------------------------------------------
depth    -                  number of hidden layers, 1 to 3
H        -                  width of every hidden layer
B        -                  batch size
x        (inputs, B)        inputs, one *column* a sample
h        (depth, H, B)      hidden activations
z        (depth, H, B)      values before activation (PReLU alone reads them)
y        (outputs, B)       outputs

Columns are samples because the networks here are narrow at both ends (4 inputs,
2 outputs) while batches are long: every loop then runs along the batch, in
vector registers, and the thin products need no BLAS. Products that are wide on
all sides go to BLAS.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels.activations import (
    CODES,
    LRELU,
    LRELU_SLOPE,
    PRELU,
    PRELU_INITIAL_SLOPE,
    activate,
    activate_backward,
)
from bilevel.kernels.jit import compiled

#: Products with an outer dimension up to this size are done row by row.
THIN = 16

_ZERO = np.float32(0)
_LRELU_SLOPE = np.float32(LRELU_SLOPE)


class Network(NamedTuple):
    """Shape of an MLP, as kernels take it."""

    sizes: NDArray[np.int64]  # (depth + 2,) inputs, hidden..., outputs
    offsets: NDArray[np.int64]  # (depth + 2,) where each layer starts in the vector
    activation: int  # a code of `activations.CODES`

    @property
    def parameter_count(self) -> int:
        return int(self.offsets[-1]) + (self.activation == PRELU)


def network(
    inputs: int, hidden_size: int, hidden_layers: int, outputs: int, activation: str
) -> Network:
    """Describe an MLP with `hidden_layers` layers of `hidden_size` units."""
    sizes = np.array([inputs] + [hidden_size] * hidden_layers + [outputs], np.int64)
    layer_lengths = sizes[:-1] * sizes[1:] + sizes[1:]
    offsets = np.concatenate([[0], np.cumsum(layer_lengths)]).astype(np.int64)
    return Network(sizes, offsets, CODES[activation])


def initial_parameters(net: Network, rng: np.random.Generator) -> NDArray[np.float32]:
    """Weights and biases uniform in +-1/sqrt(fan_in) (torch's own for linear
    layers), and 0.25 for a PReLU slope."""
    params = np.empty(net.parameter_count, np.float32)
    for layer, fan_in in enumerate(net.sizes[:-1]):
        start, end = net.offsets[layer], net.offsets[layer + 1]
        bound = 1.0 / np.sqrt(fan_in)
        params[start:end] = rng.uniform(-bound, bound, end - start)
    if net.activation == PRELU:
        params[-1] = PRELU_INITIAL_SLOPE
    return params


@compiled
def layer_weights(net, params, layer):
    n_in, n_out = net.sizes[layer], net.sizes[layer + 1]
    start = net.offsets[layer]
    return params[start : start + n_in * n_out].reshape(n_out, n_in)


@compiled
def layer_biases(net, params, layer):
    end = net.offsets[layer + 1]
    return params[end - net.sizes[layer + 1] : end]


@compiled
def negative_slope(net, params):
    """Slope of the activation for negative inputs."""
    if net.activation == PRELU:
        return params[params.size - 1]
    return _LRELU_SLOPE if net.activation == LRELU else _ZERO


@compiled
def affine(weights, biases, x, out):
    """out = weights @ x + biases, the biases broadcast along the batch.

    The thin product takes four rows of `x` at a time, so that a row of `out` is
    read and written a quarter as often. (Loops index matrices rather than slice
    rows off them: a slice costs more than a short row's arithmetic.)
    """
    n_out, n_in = weights.shape
    batch = out.shape[1]
    if n_out > THIN and n_in > THIN:
        np.dot(weights, x, out)
        for j in range(n_out):
            bias = biases[j]
            for i in range(batch):
                out[j, i] += bias
        return
    fours = n_in // 4 * 4
    for j in range(n_out):
        bias = biases[j]
        if fours:
            w0, w1, w2, w3 = weights[j, 0], weights[j, 1], weights[j, 2], weights[j, 3]
            for i in range(batch):
                out[j, i] = bias + w0 * x[0, i] + w1 * x[1, i] + w2 * x[2, i] + w3 * x[3, i]
        else:
            for i in range(batch):
                out[j, i] = bias
        for k in range(4, fours, 4):
            w0, w1, w2, w3 = weights[j, k], weights[j, k + 1], weights[j, k + 2], weights[j, k + 3]
            for i in range(batch):
                out[j, i] += w0 * x[k, i] + w1 * x[k + 1, i] + w2 * x[k + 2, i] + w3 * x[k + 3, i]
        rest = fours
        if n_in - fours >= 2:
            w0, w1 = weights[j, fours], weights[j, fours + 1]
            for i in range(batch):
                out[j, i] += w0 * x[fours, i] + w1 * x[fours + 1, i]
            rest += 2
        if rest < n_in:
            w0 = weights[j, rest]
            for i in range(batch):
                out[j, i] += w0 * x[rest, i]


@compiled
def outer_gradient(delta, x, gradient):
    """gradient = delta @ x.T, the gradient of the weights of `affine`."""
    n_out, n_in = gradient.shape
    batch = delta.shape[1]
    if n_out > THIN and n_in > THIN:
        np.dot(delta, x.T, gradient)
        return
    twos = n_in // 2 * 2
    for j in range(n_out):
        for k in range(0, twos, 2):
            s0 = s1 = _ZERO
            for i in range(batch):
                s0 += delta[j, i] * x[k, i]
                s1 += delta[j, i] * x[k + 1, i]
            gradient[j, k] = s0
            gradient[j, k + 1] = s1
        for k in range(twos, n_in):
            s0 = _ZERO
            for i in range(batch):
                s0 += delta[j, i] * x[k, i]
            gradient[j, k] = s0


@compiled
def input_gradient(weights, delta, out):
    """out = weights.T @ delta, the gradient of the inputs of `affine`."""
    n_out, n_in = weights.shape
    batch = delta.shape[1]
    if n_out > THIN:
        np.dot(weights.T, delta, out)
        return
    pairs = n_out // 2 * 2
    for k in range(n_in):
        if pairs:
            w0, w1 = weights[0, k], weights[1, k]
            for i in range(batch):
                out[k, i] = w0 * delta[0, i] + w1 * delta[1, i]
        else:
            w0 = weights[0, k]
            for i in range(batch):
                out[k, i] = w0 * delta[0, i]
        for j in range(2, n_out):
            w0 = weights[j, k]
            for i in range(batch):
                out[k, i] += w0 * delta[j, i]


@compiled
def forward(net, params, x, h, z, y):
    """Outputs for a batch into `y`; the hidden layers are left in `h` (and `z`)."""
    slope = negative_slope(net, params)
    depth = net.sizes.size - 2
    inputs = x
    for layer in range(depth):
        out = h[layer]
        affine(layer_weights(net, params, layer), layer_biases(net, params, layer), inputs, out)
        if net.activation == PRELU:
            z[layer] = out
        activate(out, net.activation, slope)
        inputs = out
    affine(layer_weights(net, params, depth), layer_biases(net, params, depth), inputs, y)


@compiled
def backward(net, params, x, h, z, delta_y, delta_h, gradient):
    """Gradient of all parameters into `gradient`, from that of the outputs,
    `delta_y` (outputs, B). `delta_h` (depth, H, B) is work space."""
    slope = negative_slope(net, params)
    slope_gradient = _ZERO
    depth = net.sizes.size - 2
    delta = delta_y
    bias_gradient = layer_biases(net, gradient, depth)
    for j in range(delta.shape[0]):
        bias_gradient[j] = delta[j].sum()
    for layer in range(depth, -1, -1):
        inputs = h[layer - 1] if layer > 0 else x
        outer_gradient(delta, inputs, layer_weights(net, gradient, layer))
        if layer > 0:
            below = delta_h[layer - 1]
            input_gradient(layer_weights(net, params, layer), delta, below)
            slope_gradient += activate_backward(
                below,
                h[layer - 1],
                z[layer - 1],
                net.activation,
                slope,
                layer_biases(net, gradient, layer - 1),
            )
            delta = below
    if net.activation == PRELU:
        gradient[gradient.size - 1] = slope_gradient


@compiled
def forward_single(net, params, x, work, y):
    """Outputs for one sample `x` (inputs,) into `y`; `work` is (2, H)."""
    slope = negative_slope(net, params)
    depth = net.sizes.size - 2
    inputs = x
    for layer in range(depth + 1):
        weights = layer_weights(net, params, layer)
        biases = layer_biases(net, params, layer)
        n_out, n_in = weights.shape
        out = work[layer % 2, :n_out] if layer < depth else y[:n_out]
        for j in range(n_out):
            total = biases[j]
            for k in range(n_in):
                total += weights[j, k] * inputs[k]
            out[j] = total
        if layer < depth:
            activate(out.reshape(1, n_out), net.activation, slope)
        inputs = out
