"""Properties of the update rules, and values computed by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bilevel.evolution import RULES, Fitness
from bilevel.hyperparameters import UPDATES

SIGMA = 0.1


def step(
    rule: str,
    z: NDArray[np.float32],
    plus: list[float],
    minus: list[float] | None = None,
    centre: float = 0.0,
    transform: str = "better-average",
) -> NDArray[np.float64]:
    mirrored = None if minus is None else np.array(minus)
    fitness = Fitness(np.array(plus), mirrored, np.array([centre]))
    weights = RULES[rule].shape(fitness, transform, "mean")
    return RULES[rule].step_size(1.0, SIGMA) * RULES[rule].estimate(weights, z)


@pytest.fixture
def z() -> NDArray[np.float32]:
    return np.random.default_rng(0).standard_normal((3, 5), np.float32)


def test_every_hyperparameter_value_has_a_rule() -> None:
    assert set(RULES) == set(UPDATES)


@pytest.mark.parametrize("rule", UPDATES)
def test_equal_scores_give_no_step_and_a_better_member_attracts(
    rule: str, z: NDArray[np.float32]
) -> None:
    equal = step(rule, z, [3.0] * 3, [3.0] * 3, 3.0)
    np.testing.assert_allclose(equal, 0, atol=1e-7)
    assert step(rule, z, [9.0, 3.0, 3.0], [3.0] * 3, 3.0) @ z[0] > 0


@pytest.mark.parametrize("rule", ["nes", "antithetic"])
@given(values=st.lists(st.integers(-500, 200), min_size=6, max_size=6))
def test_only_ranks_count(rule: str, values: list[int]) -> None:
    """Monotone transformations do not change the step, swapped signs invert it."""
    z = np.random.default_rng(0).standard_normal((3, 5), np.float32)
    plus, minus = [float(v) for v in values[:3]], [float(v) for v in values[3:]]
    expected = step(rule, z, plus, minus)
    cubed = step(rule, z, [v**3 for v in plus], [v**3 for v in minus])
    np.testing.assert_allclose(cubed, expected, rtol=1e-6)
    np.testing.assert_allclose(step(rule, z, minus, plus), -expected, atol=1e-6)


def test_paper_divides_by_n_sigma_and_authors_do_not(z: NDArray[np.float32]) -> None:
    # The better signs score 9, 6 and 1; above 5 they gain 4, 1 and 0, scaled to a maximum of 1.
    scores = [9.0, 3.0, 1.0], [2.0, 6.0, 0.0], 5.0
    eps = SIGMA * z
    total = 1.0 * eps[0] + 0.25 * -eps[1]
    np.testing.assert_allclose(step("paper", z, *scores), total / (3 * SIGMA), rtol=1e-5)
    np.testing.assert_allclose(step("authors", z, *scores), total, rtol=1e-5)


def test_antithetic_averages_centred_ranks(z: NDArray[np.float32]) -> None:
    found = step("antithetic", z, [6.0, 5.0, 4.0], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found, np.mean([[1.0], [0.6], [0.2]] * z, axis=0), rtol=1e-5)


def test_nes_sums_utilities(z: NDArray[np.float32]) -> None:
    # The best three of six have the utilities log 4 - log rank, over their sum; 1/6 cancels.
    best, second, third = np.log([4.0, 2.0, 4 / 3]) / np.log(4 * 2 * 4 / 3)
    found = step("nes", z, [6.0, 5.0, 3.0], [1.0, 2.0, 4.0])
    np.testing.assert_allclose(found, SIGMA * (np.array([best, second, -third]) @ z), rtol=1e-5)


@pytest.mark.parametrize("rule", UPDATES)
def test_non_finite_scores_rank_last(rule: str, z: NDArray[np.float32]) -> None:
    found = step(rule, z, [np.nan, 3.0, 3.0], [9.0, -np.inf, 3.0], 3.0)
    assert np.isfinite(found).all()
    assert found @ z[0] < 0


@pytest.mark.parametrize("rule", ["paper", "authors"])
def test_without_mirrored_sampling(rule: str, z: NDArray[np.float32]) -> None:
    assert step(rule, z, [1.0, 2.0, 9.0], centre=5.0) @ z[2] > 0
