"""Learning from recorded transitions, compiled: action values and regressions.

symbol   meaning
------   -------------------------------------------
N        recorded samples
B, B'    batch size; padded to whole vector registers (`mlp.padded`)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels.adam import adam_step
from bilevel.kernels.jit import compiled
from bilevel.kernels.mlp import backward, forward, padded
from bilevel.kernels.random import below
from bilevel.kernels.replay import sample
from bilevel.kernels.training import learn
from bilevel.networks import Network


@compiled
def learn_offline(agent, memory, steps, rng):
    """Make `steps` gradient steps of an agent on minibatches of a full replay `memory`."""
    for _ in range(steps):
        sample(memory, memory.shape[0], rng, agent.batch)
        learn(agent, rng)


class Regression(NamedTuple):
    """A network to fit, its optimiser and its work space."""

    net: Network
    params: NDArray[np.float32]  # (P,), fitted in place, except a PReLU slope
    gradient: NDArray[np.float32]
    first: NDArray[np.float32]  # Adam's moments
    second: NDArray[np.float32]
    x: NDArray[np.float32]  # (inputs, B')
    h: NDArray[np.float32]  # (depth, H, B')
    z: NDArray[np.float32]
    delta_h: NDArray[np.float32]
    y: NDArray[np.float32]  # (outputs, B')
    delta_y: NDArray[np.float32]


def regression(net: Network, params: NDArray[np.float32], batch_size: int) -> Regression:
    """Prepare the fit of a network that starts from `params` (P,)."""
    columns, depth, hidden = padded(batch_size), net.sizes.size - 2, int(net.sizes[1])

    def zeros(*shape: int) -> NDArray[np.float32]:
        return np.zeros(shape, np.float32)

    return Regression(
        net=net,
        params=params,
        gradient=zeros(params.size),
        first=zeros(params.size),
        second=zeros(params.size),
        x=zeros(int(net.sizes[0]), columns),
        h=zeros(depth, hidden, columns),
        z=zeros(depth, hidden, columns),
        delta_h=zeros(depth, hidden, columns),
        y=zeros(int(net.sizes[-1]), columns),
        delta_y=zeros(int(net.sizes[-1]), columns),
    )


@compiled
def fit(regression, inputs, targets, weights, batch_size, steps, learning_rate, rng):
    """Make `steps` Adam steps on the weighted mean squared error, on minibatches drawn with
    replacement; the learning rate decreases linearly to 0.

    `inputs` (N, inputs), `targets` (N, outputs) and the errors' `weights` (N, outputs) are float32.
    """
    net, trained = regression.net, regression.net.offsets[-1]
    x, y, delta_y = regression.x, regression.y, regression.delta_y
    rows = np.empty(batch_size, np.int64)
    scale = np.float32(2.0 / batch_size)
    for step in range(steps):
        for i in range(batch_size):
            rows[i] = below(rng, inputs.shape[0])
            for k in range(x.shape[0]):
                x[k, i] = inputs[rows[i], k]
        forward(net, regression.params, x, regression.h, regression.z, y)
        for k in range(y.shape[0]):
            for i in range(batch_size):
                row = rows[i]
                delta_y[k, i] = scale * weights[row, k] * (y[k, i] - targets[row, k])
        backward(
            net,
            regression.params,
            x,
            regression.h,
            regression.z,
            delta_y,
            regression.delta_h,
            regression.gradient,
        )
        adam_step(
            regression.params[:trained],
            regression.gradient[:trained],
            regression.first[:trained],
            regression.second[:trained],
            step + 1,
            learning_rate * (1.0 - step / steps),
        )
