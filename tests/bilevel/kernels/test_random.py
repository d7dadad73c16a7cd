import numpy as np
from scipy.stats import chisquare, gumbel_r, kstest, norm

from bilevel.kernels import random
from bilevel.splitmix import SplitMix64


def test_reference_values() -> None:
    """The first outputs for seed 1234567, as in Vigna's reference implementation."""
    state = np.array([1234567], np.uint64)
    drawn = [int(random.next_uint64(state)) for _ in range(3)]
    assert drawn == [6457827717110365317, 3203168211198807973, 9817491932198370423]


def test_definitions_draw_what_kernels_draw() -> None:
    state, twin = np.array([42], np.uint64), SplitMix64(42)
    for n in (2, 3, 1000, 100_000):
        assert twin.uniform() == random.uniform(state)
        assert twin.below(n, 5).tolist() == [random.below(state, n) for _ in range(5)]
    for name in ("gumbel", "normal"):
        compiled = [getattr(random, name)(state) for _ in range(500)]
        np.testing.assert_allclose(getattr(twin, name)(500), compiled, rtol=1e-6)


def test_distributions() -> None:
    twin = SplitMix64(7)
    assert kstest([twin.uniform() for _ in range(20_000)], "uniform").pvalue > 0.01
    assert kstest(twin.gumbel(20_000), gumbel_r.cdf).pvalue > 0.01
    assert kstest(twin.normal(20_000), norm.cdf).pvalue > 0.01
    counts = np.bincount(twin.below(10, 50_000), minlength=10)
    assert chisquare(counts).pvalue > 0.01
