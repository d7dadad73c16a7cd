import numpy as np
import pytest
import torch

from bilevel.kernels.activations import activate, activate_rows_backward
from bilevel.networks import CODES, TANH
from bilevel.torch_activations import activation_module

SLOPES = {"tanh": 0.0, "relu": 0.0, "lrelu": 0.01, "prelu": 0.25}


def test_tanh_is_accurate_over_its_whole_range() -> None:
    x = np.linspace(-20, 20, 200_001, dtype=np.float32).reshape(1, -1)
    y = x.copy()
    activate(y[0], np.float32(0), TANH, np.float32(0))
    np.testing.assert_allclose(y, np.tanh(x.astype(np.float64)), atol=5e-7)


@pytest.mark.parametrize("name", CODES)
def test_nan_and_infinity_are_not_hidden(name: str) -> None:
    z = np.array([[np.nan, np.inf, -np.inf]], np.float32)
    expected = activation_module(name)(torch.from_numpy(z)).detach().numpy()
    activate(z[0], np.float32(0), CODES[name], np.float32(SLOPES[name]))
    assert np.isnan(z[0, 0])
    if name == "tanh":  # saturates at the clamp
        np.testing.assert_allclose(z[0, 1:], expected[0, 1:], atol=5e-7)
    elif name == "relu":
        np.testing.assert_array_equal(z[0, 1:], expected[0, 1:])
    else:
        assert not np.isfinite(z[0, 1:]).any()


@pytest.mark.parametrize("slope", [0.25, 0.0, -0.4])
def test_prelu_gradient_holds_for_a_slope_of_any_sign(
    slope: float, rng: np.random.Generator
) -> None:
    z = rng.normal(0, 1, (4, 9)).astype(np.float32)
    delta = rng.normal(0, 1, (4, 9)).astype(np.float32)
    module = torch.nn.PReLU(init=slope)
    inputs = torch.from_numpy(z.copy()).requires_grad_()
    outputs = module(inputs)
    outputs.backward(torch.from_numpy(delta))
    assert inputs.grad is not None
    assert module.weight.grad is not None

    h, bias = outputs.detach().numpy(), np.zeros(4, np.float32)
    slope_gradient = activate_rows_backward(delta, h, z, CODES["prelu"], np.float32(slope), bias)
    np.testing.assert_allclose(delta, inputs.grad.numpy(), atol=1e-6)
    np.testing.assert_allclose(slope_gradient, module.weight.grad.item(), rtol=1e-4)
    np.testing.assert_allclose(bias, inputs.grad.numpy().sum(axis=1), atol=1e-5)
