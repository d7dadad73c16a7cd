"""A multilayer perceptron on a flat float32 parameter vector (`bilevel.networks`).

symbol   shape              meaning
------   ----------------   ------------------------------------------------
depth    -                  number of hidden layers
H        -                  width of every hidden layer
B        -                  batch size
x        (inputs, B)        inputs, one *column* a sample
h        (depth, H, B)      hidden activations
z        (depth, H, B)      values before activation (PReLU alone reads them)
y        (outputs, B)       outputs, the heads one below the other

Columns are samples, so that a bias belongs to a row and every loop runs along the batch, in vector
registers. Between two products (`products`) there is one pass over the batch.
"""

import numpy as np

from bilevel import networks
from bilevel.activations import LRELU, LRELU_SLOPE, PRELU
from bilevel.kernels.activations import activate, activate_rows, activate_rows_backward
from bilevel.kernels.jit import compiled
from bilevel.kernels.products import product
from bilevel.kernels.tiles import LANES

_ZERO = np.float32(0)
_LRELU_SLOPE = np.float32(LRELU_SLOPE)


def padded(batch_size: int) -> int:
    """The batch size, rounded up to whole tiles, so that no loop ends with single samples."""
    return -(-batch_size // LANES) * LANES


#: Compiled versions of the functions in `bilevel.networks`.
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
    """Write the outputs for a batch into `y`, and the hidden layers into `h` (and `z`)."""
    slope = negative_slope(net, params)
    depth = net.sizes.size - 2
    inputs = x
    for layer in range(depth):
        out = h[layer]
        product(layer_weights(net, params, layer), inputs, out)
        activate_rows(out, z[layer], layer_biases(net, params, layer), net.activation, slope)
        inputs = out
    unit = output = 0
    for head in range(net.heads.shape[0]):
        n_in, n_out = net.heads[head, 0], net.heads[head, 1]
        biases = layer_biases(net, params, depth + head)
        out = y[output : output + n_out]
        product(layer_weights(net, params, depth + head), inputs[unit : unit + n_in], out)
        for a in range(n_out):
            bias = biases[a]
            for i in range(out.shape[1]):
                out[a, i] += bias
        unit += n_in
        output += n_out


@compiled
def backward(net, params, x, h, z, delta_y, delta_h, gradient):
    """Write the gradient of all parameters into `gradient`, given the gradient `delta_y`
    (outputs, B) of the outputs, and the gradient of the hidden layers into `delta_h`."""
    depth = net.sizes.size - 2
    top, unit, output = h[depth - 1], 0, 0
    for head in range(net.heads.shape[0]):
        n_in, n_out = net.heads[head, 0], net.heads[head, 1]
        delta = delta_y[output : output + n_out]
        weight_gradient = layer_weights(net, gradient, depth + head)
        product(delta, top[unit : unit + n_in].T, weight_gradient)
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
        product(delta_h[layer], inputs.T, layer_weights(net, gradient, layer))


@compiled
def propagate(net, params, h, z, delta_y, delta_h, gradient):
    """Compute the part of `backward` that passes down the layers: `delta_h` (depth, H, B), and the
    gradients of hidden biases and slope."""
    slope = negative_slope(net, params)
    slope_gradient = _ZERO
    depth = net.sizes.size - 2
    delta, unit, output = delta_h[depth - 1], 0, 0
    for head in range(net.heads.shape[0]):
        n_in, n_out = net.heads[head, 0], net.heads[head, 1]
        weights = layer_weights(net, params, depth + head)
        product(weights.T, delta_y[output : output + n_out], delta[unit : unit + n_in])
        unit += n_in
        output += n_out
    for layer in range(depth - 1, -1, -1):
        if layer < depth - 1:
            product(layer_weights(net, params, layer + 1).T, delta_h[layer + 1], delta_h[layer])
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
    """Write the outputs for one sample `x` (inputs,) into `y` (outputs,); `work` is (2, H)."""
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
