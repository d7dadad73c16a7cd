"""The compiled fits against torch, and learning from recorded transitions."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.kernels import ddqn
from bilevel.kernels.offline import fit, learn_offline, regression
from bilevel.networks import initial_parameters, network
from bilevel.splitmix import SplitMix64
from bilevel.torch_activations import activation_module


@pytest.mark.parametrize("activation", ["tanh", "relu", "lrelu", "prelu"])
def test_a_fit_is_torchs(activation: str) -> None:
    """Adam on the weighted squared error with a linearly decreasing learning rate; a PReLU slope is
    not fitted."""
    n, batch, steps, rate = 50, 20, 30, 1e-2
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(n, 3)).astype(np.float32)
    targets = rng.normal(size=(n, 2)).astype(np.float32)
    weights = rng.uniform(0.5, 2.0, (n, 2)).astype(np.float32)
    net = network(3, 8, 2, 2, activation)
    params = initial_parameters(net, rng)

    function = activation_module(activation)
    linear = [torch.nn.Linear(3, 8), torch.nn.Linear(8, 8), torch.nn.Linear(8, 2)]
    module = torch.nn.Sequential(linear[0], function, linear[1], function, linear[2])
    trained = [p for layer in linear for p in layer.parameters()]
    torch.nn.utils.vector_to_parameters(torch.from_numpy(params.copy()), trained)
    adam = torch.optim.Adam(trained, lr=rate)
    draws = SplitMix64(7)
    for step in range(steps):
        rows = draws.below(n, batch)
        adam.param_groups[0]["lr"] = rate * (1 - step / steps)
        error = module(torch.from_numpy(inputs[rows])) - torch.from_numpy(targets[rows])
        loss = (torch.from_numpy(weights[rows]) * error**2).sum() / batch
        adam.zero_grad()
        loss.backward()
        adam.step()
    expected = torch.nn.utils.parameters_to_vector(trained).detach().numpy()

    state = np.array([7], np.uint64)
    fit(regression(net, params, batch), inputs, targets, weights, batch, steps, rate, state)
    np.testing.assert_allclose(params[: expected.size], expected, atol=2e-4)
    assert (params[expected.size :] == 0.25).all()


def test_an_agent_learns_from_recorded_transitions(small_agent: DDQNHyperparameters) -> None:
    """The second of two actions is always rewarded; every episode has one step."""
    rng = np.random.default_rng(0)
    states = rng.normal(size=(200, 3))
    actions = rng.integers(2, size=200)
    memory = np.column_stack([states, states, actions, np.ones(200), actions]).astype(np.float32)
    agent = ddqn.new_agent(replace(small_agent, learning_rate=0.01), 3, 2, rng)
    learn_offline(agent, memory, 500, np.array([1], np.uint64))
    h = np.empty((small_agent.hidden_layers, small_agent.hidden_size, 200), np.float32)
    q = np.empty((2, 200), np.float32)
    ddqn.action_values(
        agent, agent.theta, np.ascontiguousarray(memory[:, :3].T), h, np.empty_like(h), q
    )
    np.testing.assert_allclose(q.mean(axis=1), [0.0, 1.0], atol=0.1)
