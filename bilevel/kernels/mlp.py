"""A multilayer perceptron on a flat float32 parameter vector (`bilevel.networks`).

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

import numpy as np

from bilevel import networks
from bilevel.activations import LRELU, LRELU_SLOPE, PRELU
from bilevel.kernels.activations import activate, activate_rows, activate_rows_backward
from bilevel.kernels.jit import compiled

#: Batches are padded to a multiple of so many samples: loops then end with a whole
#: vector register instead of a rest, which would go sample by sample.
LANES = 16

_ZERO = np.float32(0)
_LRELU_SLOPE = np.float32(LRELU_SLOPE)


def padded(batch_size: int) -> int:
    """The batch size, rounded up to whole vector registers."""
    return -(-batch_size // LANES) * LANES


#: Compiled for the kernels.
layer_weights = compiled(networks.layer_weights)
layer_biases = compiled(networks.layer_biases)


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
