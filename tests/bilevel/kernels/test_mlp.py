import numpy as np
import pytest
import torch

from bilevel.agents.ddqn import MLP
from bilevel.hyperparameters import ACTIVATIONS
from bilevel.kernels import mlp
from bilevel.networks import initial_parameters, network

SHAPES = [(4, 8, 1, 2), (6, 24, 2, 3), (3, 20, 3, 5), (30, 40, 2, 18), (1, 1, 1, 1)]


def networks(shape: tuple[int, int, int, int], activation: str):  # type: ignore[no-untyped-def]
    n_in, hidden, depth, n_out = shape
    net = network(n_in, hidden, depth, n_out, activation)
    params = initial_parameters(net, np.random.default_rng(5))
    module = MLP(n_in, n_out, hidden, depth, activation)
    torch.nn.utils.vector_to_parameters(torch.from_numpy(params.copy()), module.parameters())
    return net, params, module


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("batch", [1, 7, 33])
def test_forward_and_backward_equal_torch(
    shape: tuple[int, int, int, int], activation: str, batch: int, rng: np.random.Generator
) -> None:
    net, params, module = networks(shape, activation)
    n_in, hidden, depth, n_out = shape
    x = rng.normal(0, 1, (n_in, batch)).astype(np.float32)
    delta = rng.normal(0, 1, (n_out, batch)).astype(np.float32)
    h, z, delta_h = (np.zeros((depth, hidden, batch), np.float32) for _ in range(3))
    y, gradient = np.zeros((n_out, batch), np.float32), np.zeros_like(params)
    mlp.forward(net, params, x, h, z, y)
    mlp.backward(net, params, x, h, z, delta, delta_h, gradient)

    outputs = module(torch.from_numpy(x.T.copy()))
    outputs.backward(torch.from_numpy(delta.T.copy()))
    expected = torch.cat([p.grad.flatten() for p in module.parameters()])
    np.testing.assert_allclose(y, outputs.detach().numpy().T, atol=2e-6)
    np.testing.assert_allclose(gradient, expected.numpy(), atol=2e-4, rtol=1e-4)


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("shape", SHAPES)
def test_single_equals_batch(
    shape: tuple[int, int, int, int], activation: str, rng: np.random.Generator
) -> None:
    net, params, _ = networks(shape, activation)
    n_in, hidden, depth, n_out = shape
    x = rng.normal(0, 1, (n_in, 9)).astype(np.float32)
    h, z = (np.zeros((depth, hidden, 9), np.float32) for _ in range(2))
    y = np.zeros((n_out, 9), np.float32)
    mlp.forward(net, params, x, h, z, y)
    work, single = np.zeros((2, hidden), np.float32), np.zeros(n_out, np.float32)
    for i in range(9):
        mlp.forward_single(net, params, x[:, i].copy(), work, single)
        np.testing.assert_allclose(single, y[:, i], atol=2e-6)


def test_initial_parameters_are_uniform_in_the_fan_in_bound() -> None:
    net = network(4, 300, 2, 2, "prelu")
    params = initial_parameters(net, np.random.default_rng(0))
    assert params.size == net.parameter_count == 4 * 300 + 300 + 300 * 300 + 300 + 600 + 2 + 1
    middle = params[net.offsets[1] : net.offsets[2]]
    bound = 300**-0.5
    assert abs(middle).max() <= bound
    assert middle.std() == pytest.approx(bound / 3**0.5, rel=0.02)
    assert params[-1] == 0.25
