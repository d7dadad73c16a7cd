"""Shapes of multilayer perceptrons, and the layout of their parameters in a flat float32 vector.

The output consists of heads: linear layers that each read a range of the last hidden layer's units
(for instance value and advantages of a dueling network). The layout is that of torch's
`parameters_to_vector`: for each layer, then each head, the weights (outputs x inputs, row-major)
and the biases; last, for PReLU, the one slope shared by all hidden layers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Parameters = NDArray[np.float32]

TANH, RELU, LRELU, PRELU = 0, 1, 2, 3
#: Codes of the activation functions by name.
CODES = {"tanh": TANH, "relu": RELU, "lrelu": LRELU, "prelu": PRELU}
#: Slope of LeakyReLU, and initial slope of PReLU (torch's defaults).
LRELU_SLOPE, PRELU_INITIAL_SLOPE = 0.01, 0.25


class Network(NamedTuple):
    """Shape of an MLP, in the form of the kernels."""

    sizes: NDArray[np.int64]  # (depth + 2,) inputs, hidden..., outputs
    heads: NDArray[np.int64]  # (n, 2) hidden units that a head reads, its outputs
    offsets: NDArray[np.int64]  # (depth + n + 1,) where layers and heads start in the vector
    activation: int  # a code in CODES

    @property
    def parameter_count(self) -> int:
        return int(self.offsets[-1]) + (self.activation == PRELU)

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """(inputs, outputs) of every hidden layer and head."""
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
    """Describe an MLP. `heads` are (units read, outputs) of each head; by default one reads all."""
    sizes = np.array([inputs] + [hidden_size] * hidden_layers + [outputs], np.int64)
    split = np.array(heads or [(hidden_size, outputs)], np.int64)
    net = Network(sizes, split, np.zeros(1, np.int64), CODES[activation])
    lengths = [n_in * n_out + n_out for n_in, n_out in net.shapes]
    return net._replace(offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64))


def initial_parameters(net: Network, rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw weights and biases uniformly in +-1/sqrt(fan_in), torch's default for linear layers."""
    params = np.empty(net.parameter_count, np.float32)
    for layer, (fan_in, _) in enumerate(net.shapes):
        start, end = net.offsets[layer], net.offsets[layer + 1]
        bound = 1.0 / np.sqrt(fan_in)
        params[start:end] = rng.uniform(-bound, bound, end - start)
    if net.activation == PRELU:
        params[-1] = PRELU_INITIAL_SLOPE
    return params


def orthogonal_parameters(
    net: Network, rng: np.random.Generator, output_gain: float
) -> NDArray[np.float32]:
    """Draw orthogonal weights, scaled by sqrt(2), those of the heads by `output_gain`; biases are
    zero (Huang et al., 2022, "The 37 Implementation Details of PPO")."""
    params = np.zeros(net.parameter_count, np.float32)
    depth = net.sizes.size - 2
    for layer, (n_in, n_out) in enumerate(net.shapes):
        left, _, right = np.linalg.svd(rng.standard_normal((n_out, n_in)), full_matrices=False)
        gain = output_gain if layer >= depth else np.sqrt(2.0)
        layer_weights(net, params, layer)[...] = gain * (left @ right)
    if net.activation == PRELU:
        params[-1] = PRELU_INITIAL_SLOPE
    return params


def layer_weights(net: Network, params: Parameters, layer: int) -> Parameters:
    """Weights (outputs, inputs) of a hidden layer, or of head `layer - depth`."""
    depth = net.sizes.size - 2
    if layer < depth:
        n_in, n_out = net.sizes[layer], net.sizes[layer + 1]
    else:
        n_in, n_out = net.heads[layer - depth, 0], net.heads[layer - depth, 1]
    start = net.offsets[layer]
    return params[start : start + n_in * n_out].reshape(n_out, n_in)


def layer_biases(net: Network, params: Parameters, layer: int) -> Parameters:
    """Biases (outputs,) of a hidden layer, or of head `layer - depth`."""
    depth = net.sizes.size - 2
    n_out = net.sizes[layer + 1] if layer < depth else net.heads[layer - depth, 1]
    end = net.offsets[layer + 1]
    return params[end - n_out : end]
