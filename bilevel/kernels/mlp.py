"""A multilayer perceptron on a flat float32 parameter vector.

Its outputs are one head or several: linear layers that read a range of the last
hidden layer's units each, side by side (the value and the advantages of a dueling
network). The vector lies as torch's `parameters_to_vector` lays it: per layer, then
per head, the weights (outputs x inputs, row-major) and the biases; last, for PReLU,
the one slope that all hidden layers of the network share.

symbol   shape              meaning
------   ----------------   ------------------------------------------------
depth    -                  number of hidden layers
H        -                  width of every hidden layer
B        -                  batch size
x        (inputs, B)        inputs, one *column* a sample
h        (depth, H, B)      hidden activations
z        (depth, H, B)      values before activation (PReLU alone reads them)
y        (outputs, B)       outputs, one head's below the other's

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
    heads: NDArray[np.int64]  # (n, 2) hidden units that a head reads, its outputs
    offsets: NDArray[np.int64]  # (depth + n + 1,) where layers and heads start in the vector
    activation: int  # a code of `activations.CODES`

    @property
    def parameter_count(self) -> int:
        return int(self.offsets[-1]) + (self.activation == PRELU)

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Inputs and outputs of every hidden layer and head."""
        hidden = zip(self.sizes[:-2], self.sizes[1:-1], strict=True)
        return [(int(n_in), int(n_out)) for n_in, n_out in [*hidden, *self.heads]]


def network(
    inputs: int,
    hidden_size: int,
    hidden_layers: int,
    outputs: int,
    activation: str,
    heads: tuple[tuple[int, int], ...] = (),
) -> Network:
    """Describe an MLP with `hidden_layers` layers of `hidden_size` units.

    `heads` split the last hidden layer: (units read, outputs) of each, in sum
    `hidden_size` and `outputs`; without them, one head reads all.
    """
    sizes = np.array([inputs] + [hidden_size] * hidden_layers + [outputs], np.int64)
    split = np.array(heads or [(hidden_size, outputs)], np.int64)
    net = Network(sizes, split, np.zeros(1, np.int64), CODES[activation])
    lengths = [n_in * n_out + n_out for n_in, n_out in net.shapes]
    return net._replace(offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64))


def padded(batch_size: int) -> int:
    """The batch size, rounded up to whole vector registers."""
    return -(-batch_size // LANES) * LANES


def initial_parameters(net: Network, rng: np.random.Generator) -> NDArray[np.float32]:
    """Weights and biases uniform in +-1/sqrt(fan_in) (torch's own for linear
    layers), and 0.25 for a PReLU slope."""
    params = np.empty(net.parameter_count, np.float32)
    for layer, (fan_in, _) in enumerate(net.shapes):
        start, end = net.offsets[layer], net.offsets[layer + 1]
        bound = 1.0 / np.sqrt(fan_in)
        params[start:end] = rng.uniform(-bound, bound, end - start)
    if net.activation == PRELU:
        params[-1] = PRELU_INITIAL_SLOPE
    return params


@compiled
def layer_weights(net, params, layer):
    """Weights (outputs, inputs) of a hidden layer, or of head `layer - depth`."""
    depth = net.sizes.size - 2
    if layer < depth:
        n_in, n_out = net.sizes[layer], net.sizes[layer + 1]
    else:
        n_in, n_out = net.heads[layer - depth, 0], net.heads[layer - depth, 1]
    start = net.offsets[layer]
    return params[start : start + n_in * n_out].reshape(n_out, n_in)


@compiled
def layer_biases(net, params, layer):
    """Biases (outputs,) of a hidden layer, or of head `layer - depth`."""
    depth = net.sizes.size - 2
    n_out = net.sizes[layer + 1] if layer < depth else net.heads[layer - depth, 1]
    end = net.offsets[layer + 1]
    return params[end - n_out : end]


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
    unit = output = 0
    for head in range(net.heads.shape[0]):
        n_in, n_out = net.heads[head, 0], net.heads[head, 1]
        biases = layer_biases(net, params, depth + head)
        out = y[output : output + n_out]
        np.dot(layer_weights(net, params, depth + head), inputs[unit : unit + n_in], out)
        for a in range(n_out):
            bias = biases[a]
            for i in range(out.shape[1]):
                out[a, i] += bias
        unit += n_in
        output += n_out


@compiled
def backward(net, params, x, h, z, delta_y, delta_h, gradient):
    """Gradient of all parameters into `gradient`, from that of the outputs,
    `delta_y` (outputs, B); that of the hidden layers is left in `delta_h`."""
    depth = net.sizes.size - 2
    top, unit, output = h[depth - 1], 0, 0
    for head in range(net.heads.shape[0]):
        n_in, n_out = net.heads[head, 0], net.heads[head, 1]
        delta = delta_y[output : output + n_out]
        weight_gradient = layer_weights(net, gradient, depth + head)
        np.dot(delta, top[unit : unit + n_in].T, weight_gradient)
        bias_gradient = layer_biases(net, gradient, depth + head)
        for a in range(n_out):
            total = _ZERO
            for i in range(delta.shape[1]):
                total += delta[a, i]
            bias_gradient[a] = total
        unit += n_in
        output += n_out
    propagate(net, params, h, z, delta_y, delta_h, gradient)
    for layer in range(depth):
        inputs = h[layer - 1] if layer > 0 else x
        np.dot(delta_h[layer], inputs.T, layer_weights(net, gradient, layer))


@compiled
def propagate(net, params, h, z, delta_y, delta_h, gradient):
    """The part of `backward` that goes down the layers: `delta_h` (depth, H, B), and
    the gradients of hidden biases and slope, which fall off on the way."""
    slope = negative_slope(net, params)
    slope_gradient = _ZERO
    depth = net.sizes.size - 2
    delta, unit, output = delta_h[depth - 1], 0, 0
    for head in range(net.heads.shape[0]):
        n_in, n_out = net.heads[head, 0], net.heads[head, 1]
        weights = layer_weights(net, params, depth + head)
        np.dot(weights.T, delta_y[output : output + n_out], delta[unit : unit + n_in])
        unit += n_in
        output += n_out
    for layer in range(depth - 1, -1, -1):
        if layer < depth - 1:
            np.dot(layer_weights(net, params, layer + 1).T, delta_h[layer + 1], delta_h[layer])
        slope_gradient += activate_rows_backward(
            delta_h[layer],
            h[layer],
            z[layer],
            net.activation,
            slope,
            layer_biases(net, gradient, layer),
        )
    if net.activation == PRELU:
        gradient[gradient.size - 1] = slope_gradient


@compiled
def forward_single(net, params, x, work, y):
    """Outputs for one sample `x` (inputs,) into `y`; `work` is (2, H)."""
    slope = negative_slope(net, params)
    depth = net.sizes.size - 2
    inputs = x
    for layer in range(depth):
        out = work[layer % 2]
        weights = layer_weights(net, params, layer)
        _affine(weights, layer_biases(net, params, layer), inputs, out)
        activate(out, net.activation, slope)
        inputs = out
    unit = output = 0
    for head in range(net.heads.shape[0]):
        n_in, n_out = net.heads[head, 0], net.heads[head, 1]
        weights = layer_weights(net, params, depth + head)
        biases = layer_biases(net, params, depth + head)
        _affine(weights, biases, inputs[unit : unit + n_in], y[output : output + n_out])
        unit += n_in
        output += n_out


@compiled
def _affine(weights, biases, x, out):
    for j in range(weights.shape[0]):
        total = biases[j]
        for k in range(weights.shape[1]):
            total += weights[j, k] * x[k]
        out[j] = total
