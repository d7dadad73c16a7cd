"""Initial parameters of networks."""

import numpy as np

from bilevel.networks import layer_biases, layer_weights, network, orthogonal_parameters


def test_orthogonal_weights_keep_lengths() -> None:
    """Rows or columns are orthogonal, and all singular values equal the gain."""
    net = network(5, 16, 2, 3, "tanh")
    params = orthogonal_parameters(net, np.random.default_rng(0), output_gain=0.01)
    for layer, gain in enumerate((np.sqrt(2.0), np.sqrt(2.0), 0.01)):
        values = np.linalg.svd(layer_weights(net, params, layer), compute_uv=False)
        np.testing.assert_allclose(values, gain, rtol=1e-5)
        assert not layer_biases(net, params, layer).any()
