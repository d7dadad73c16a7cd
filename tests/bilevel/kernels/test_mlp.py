import numpy as np
import pytest
import torch

from bilevel.agents.modules import MLP
from bilevel.hyperparameters import ACTIVATIONS
from bilevel.kernels import mlp
from bilevel.networks import initial_parameters, network

SHAPES = [(4, 8, 1, 2), (6, 24, 2, 3), (3, 20, 3, 5), (30, 40, 2, 18), (1, 1, 1, 1)]


def networks(shape: tuple[int, int, int, int], activation: str):  # type: ignore[no-untyped-def]
    n_in, hidden, depth, n_out = shape
    net = network(n_in, hidden, depth, n_out, activation)
    params = initial_parameters(net, np.random.default_rng(5))
    return net, params, MLP(net, activation, params)


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
    work = mlp.Work(
        mlp.zeros(depth, hidden, batch),
        mlp.zeros(depth, hidden, batch),
        mlp.zeros(depth, hidden, batch),
        mlp.zeros(2, hidden),
    )
    y, gradient = mlp.zeros(n_out, batch), np.zeros_like(params)
    mlp.forward(net, params, x, work, y)
    mlp.backward(net, params, x, work, delta, gradient)

    outputs = module(torch.from_numpy(x.T.copy()))
    outputs.backward(torch.from_numpy(delta.T.copy()))
    expected = torch.cat([p.grad.flatten() for p in module.parameters()])
    np.testing.assert_allclose(y, outputs.detach().numpy().T, atol=2e-6)
    np.testing.assert_allclose(gradient, expected.numpy(), atol=2e-4, rtol=1e-4)


def test_initial_parameters_are_uniform_in_the_fan_in_bound() -> None:
    net = network(4, 300, 2, 2, "prelu")
    params = initial_parameters(net, np.random.default_rng(0))
    assert params.size == net.parameter_count == 4 * 300 + 300 + 300 * 300 + 300 + 600 + 2 + 1
    middle = params[net.offsets[1] : net.offsets[2]]
    bound = 300**-0.5
    assert abs(middle).max() <= bound
    assert middle.std() == pytest.approx(bound / 3**0.5, rel=0.02)
    assert params[-1] == 0.25
