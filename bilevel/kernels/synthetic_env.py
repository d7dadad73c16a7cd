"""One step of a synthetic environment, compiled.

The three networks (next state, reward, done) read the same input, so their first layers are
concatenated into one layer of width 3H. An index as action, which is one-hot, selects a column of
its weights.

symbol   meaning
------   ------------------------------------------------------------
S, A     state size, number of actions or length of an action vector
H        hidden width of one network
"""

from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from bilevel.kernels.activations import activate
from bilevel.kernels.jit import OPTIONS, compiled
from bilevel.kernels.mlp import layer_biases, layer_weights
from bilevel.networks import Network

#: The done output above which an episode ends.
DONE = 0.5

_ZERO = np.float32(0)


class SEKernel(NamedTuple):
    """Parameters of an SE, arranged for `step`."""

    biases: NDArray[np.float32]  # (3H,) of the first layer
    action_weights: NDArray[np.float32]  # (A, 3H) first-layer weights, transposed
    state_weights: NDArray[np.float32]  # (S, 3H) first-layer weights, transposed
    hidden_weights: NDArray[np.float32]  # (3 * (layers - 1), H, H) further layers, transposed
    hidden_biases: NDArray[np.float32]  # (3 * (layers - 1), H)
    output_weights: NDArray[np.float32]  # (S + 2, H)
    output_biases: NDArray[np.float32]  # (S + 2,)
    activation: int
    slope: np.float32


def prepare(
    networks: tuple[Network, Network, Network],
    parameters: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    action_size: int,
    slope: float,
) -> SEKernel:
    """Arrange the next-state, reward and done networks for `step`."""
    depth = networks[0].sizes.size - 2
    pairs = list(zip(networks, parameters, strict=True))
    weights = [[layer_weights(n, p, layer) for layer in range(depth + 1)] for n, p in pairs]
    biases = [[layer_biases(n, p, layer) for layer in range(depth + 1)] for n, p in pairs]
    first = np.concatenate([w[0] for w in weights])  # (3H, A + S)
    hidden = int(networks[0].sizes[1])
    middle = [w[layer].T for w in weights for layer in range(1, depth)]
    middle_bias = [b[layer] for b in biases for layer in range(1, depth)]
    return SEKernel(
        np.concatenate([b[0] for b in biases]),
        np.ascontiguousarray(first[:, :action_size].T),
        np.ascontiguousarray(first[:, action_size:].T),
        np.ascontiguousarray(middle, np.float32).reshape(-1, hidden, hidden),
        np.ascontiguousarray(middle_bias, np.float32).reshape(-1, hidden),
        np.concatenate([w[depth] for w in weights]),
        np.concatenate([b[depth] for b in biases]),
        networks[0].activation,
        np.float32(slope),
    )


def work_space(se: SEKernel) -> NDArray[np.float32]:
    """Memory (2, 3H) for the hidden layers of `step`."""
    return np.zeros((2, se.biases.size), np.float32)


def add_action(se, action, h):
    """Write biases + action_weights.T @ action into `h` (3H,). The action is an index, which counts
    as one-hot, or a vector (A,)."""


@overload(add_action, jit_options=OPTIONS, strict=False)
def _add_action(se, action, h):
    def add_index(se, action, h):
        for j in range(h.size):
            h[j] = se.biases[j] + se.action_weights[action, j]

    def add_vector(se, action, h):
        h[:] = se.biases
        for k in range(action.size):
            x = action[k]
            for j in range(h.size):
                h[j] += x * se.action_weights[k, j]

    return add_vector if isinstance(action, types.Array) else add_index


@compiled
def step(se, state, action, next_state, work):
    """Write the next state into `next_state` (S,); return reward and raw done output. The action is
    an index or a vector (A,)."""
    h = work[0]
    add_action(se, action, h)
    for k in range(state.size):
        x = state[k]
        for j in range(h.size):
            h[j] += x * se.state_weights[k, j]
    activate(h, _ZERO, se.activation, se.slope)

    n_hidden = se.output_weights.shape[1]
    further = se.hidden_weights.shape[0] // 3
    for layer in range(further):
        out = work[(layer + 1) % 2]
        for net in range(3):
            weights = se.hidden_weights[net * further + layer]
            part = out[net * n_hidden : (net + 1) * n_hidden]
            part[:] = se.hidden_biases[net * further + layer]
            for k in range(n_hidden):
                x = h[net * n_hidden + k]
                for j in range(n_hidden):
                    part[j] += x * weights[k, j]
        h = out
        activate(h, _ZERO, se.activation, se.slope)

    n_states = next_state.size
    reward = se.output_biases[n_states]
    done = se.output_biases[n_states + 1]
    for j in range(n_hidden):
        reward += se.output_weights[n_states, j] * h[n_hidden + j]
        done += se.output_weights[n_states + 1, j] * h[2 * n_hidden + j]
    for k in range(n_states):
        total = se.output_biases[k]
        for j in range(n_hidden):
            total += se.output_weights[k, j] * h[j]
        next_state[k] = total
    return reward, done


@compiled
def step_all(se, states, actions, next_states, rewards, dones, work):
    """`step` of N copies: `states` and `next_states` are (N, S), the others (N,); `actions` are
    (N,) indices or (N, A) vectors."""
    for copy in range(rewards.size):
        rewards[copy], dones[copy] = step(se, states[copy], actions[copy], next_states[copy], work)
