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

Columns are samples, so that a bias belongs to a row and every loop runs along the
batch, in vector registers. All products go to BLAS, whose kernels for small
matrices are close to the processor's peak even for the thin ones (4 inputs, 2
outputs); what lies between two products is one pass over the batch.
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
    activate_rows,
    activate_rows_backward,
)
from bilevel.kernels.jit import compiled

#: Batches are padded to a multiple of so many samples: loops then end with a whole
#: vector register instead of a rest, which would go sample by sample.
LANES = 16

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


def padded(batch_size: int) -> int:
    """The batch size, rounded up to whole vector registers."""
    return -(-batch_size // LANES) * LANES


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
def forward(net, params, x, h, z, y):
    """Outputs for a batch into `y`; the hidden layers are left in `h` (and `z`)."""
    slope = negative_slope(net, params)
    depth = net.sizes.size - 2
    inputs = x
    for layer in range(depth):
        out = h[layer]
        np.dot(layer_weights(net, params, layer), inputs, out)
        activate_rows(out, z[layer], layer_biases(net, params, layer), net.activation, slope)
        inputs = out
    biases = layer_biases(net, params, depth)
    np.dot(layer_weights(net, params, depth), inputs, y)
    for a in range(y.shape[0]):
        bias = biases[a]
        for i in range(y.shape[1]):
            y[a, i] += bias


@compiled
def backward(net, params, x, h, z, delta_y, delta_h, gradient):
    """Gradient of all parameters into `gradient`, from that of the outputs,
    `delta_y` (outputs, B). `delta_h` (depth, H, B) is work space."""
    slope = negative_slope(net, params)
    slope_gradient = _ZERO
    depth = net.sizes.size - 2
    bias_gradient = layer_biases(net, gradient, depth)
    for a in range(delta_y.shape[0]):
        total = _ZERO
        for i in range(delta_y.shape[1]):
            total += delta_y[a, i]
        bias_gradient[a] = total
    delta = delta_y
    for layer in range(depth, 0, -1):
        below = delta_h[layer - 1]
        np.dot(delta, h[layer - 1].T, layer_weights(net, gradient, layer))
        np.dot(layer_weights(net, params, layer).T, delta, below)
        slope_gradient += activate_rows_backward(
            below,
            h[layer - 1],
            z[layer - 1],
            net.activation,
            slope,
            layer_biases(net, gradient, layer - 1),
        )
        delta = below
    np.dot(delta, x.T, layer_weights(net, gradient, 0))
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
            activate(out, net.activation, slope)
        inputs = out
