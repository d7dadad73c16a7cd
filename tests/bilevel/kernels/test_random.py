import numpy as np
from scipy.stats import chisquare, kstest

from bilevel.kernels.random import below, next_uint64, uniform
from bilevel.splitmix import SplitMix64


def test_reference_values() -> None:
    """The first outputs for seed 1234567, as in Vigna's reference implementation."""
    state = np.array([1234567], np.uint64)
    drawn = [int(next_uint64(state)) for _ in range(3)]
    assert drawn == [6457827717110365317, 3203168211198807973, 9817491932198370423]


def test_python_draws_what_the_kernel_draws() -> None:
    state, twin = np.array([42], np.uint64), SplitMix64(42)
    for n in (2, 3, 1000, 100_000):
        assert twin.uniform() == uniform(state)
        assert twin.below(n, 5).tolist() == [below(state, n) for _ in range(5)]


def test_uniform_is_uniform() -> None:
    state = np.array([7], np.uint64)
    assert kstest([uniform(state) for _ in range(20_000)], "uniform").pvalue > 0.01


def test_below_is_uniform() -> None:
    counts = np.bincount(SplitMix64(3).below(10, 50_000), minlength=10)
    assert chisquare(counts).pvalue > 0.01
