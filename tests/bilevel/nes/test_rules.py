"""Properties of the update rules, and values computed by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bilevel.hyperparameters import UPDATES, NESHyperparameters, load_recipe
from bilevel.nes.rules import RULES, MemberScores

SIGMA = np.full(5, 0.1, np.float32)


def hyperparameters(**changes: object) -> NESHyperparameters:
    from dataclasses import replace

    return replace(load_recipe("paper", "CartPole-v0").nes, step_size=0.5, **changes)  # type: ignore[arg-type]


def scores(
    plus: list[float], minus: list[float] | None = None, centre: float = 0.0
) -> MemberScores:
    return MemberScores(
        np.array([centre]), np.array(plus), None if minus is None else np.array(minus)
    )


@pytest.fixture
def z() -> NDArray[np.float32]:
    return np.random.default_rng(0).standard_normal((3, 5), np.float32)


def test_every_rule_is_there() -> None:
    assert set(RULES) == set(UPDATES)


@pytest.mark.parametrize("name", UPDATES)
def test_equal_scores_move_nothing_and_a_better_member_attracts(
    name: str, z: NDArray[np.float32]
) -> None:
    hp = hyperparameters(update=name)
    equal = RULES[name].step(hp, SIGMA, z, scores([3.0] * 3, [3.0] * 3, 3.0))
    np.testing.assert_allclose(equal, 0, atol=1e-7)
    step = RULES[name].step(hp, SIGMA, z, scores([9.0, 3.0, 3.0], [3.0] * 3, 3.0))
    assert step @ z[0] > 0
    assert step.dtype == np.float32


@pytest.mark.parametrize("name", ["snes", "antithetic"])
@given(values=st.lists(st.integers(-500, 200), min_size=6, max_size=6))
def test_ranks_alone_count(name: str, values: list[int]) -> None:
    """Any monotone transformation of the scores gives the same step; swapped signs the opposite."""
    z = np.random.default_rng(0).standard_normal((3, 5), np.float32)
    hp, rule = hyperparameters(update=name), RULES[name]
    plus, minus = [float(v) for v in values[:3]], [float(v) for v in values[3:]]
    step = rule.step(hp, SIGMA, z, scores(plus, minus))
    cubed = rule.step(hp, SIGMA, z, scores([v**3 for v in plus], [v**3 for v in minus]))
    np.testing.assert_allclose(step, cubed, rtol=1e-6)
    np.testing.assert_allclose(rule.step(hp, SIGMA, z, scores(minus, plus)), -step, atol=1e-6)


def test_paper_divides_and_authors_do_not(z: NDArray[np.float32]) -> None:
    members = scores([9.0, 3.0, 1.0], [2.0, 6.0, 0.0], centre=5.0)
    # better average: the better signs score 9, 6, 1; above 5 they gain 4 and 1, highest 1.
    eps = SIGMA * z
    total = 1.0 * eps[0] + 0.25 * -eps[1]
    paper = RULES["paper"].step(hyperparameters(update="paper"), SIGMA, z, members)
    np.testing.assert_allclose(paper, 0.5 / (3 * 0.1) * total, rtol=1e-5)
    authors = RULES["authors"].step(hyperparameters(update="authors"), SIGMA, z, members)
    np.testing.assert_allclose(authors, 0.5 * total, rtol=1e-5)


def test_antithetic_is_the_mean_over_members_of_centred_ranks(z: NDArray[np.float32]) -> None:
    members = scores([6.0, 5.0, 4.0], [1.0, 2.0, 3.0])
    step = RULES["antithetic"].step(hyperparameters(update="antithetic"), SIGMA, z, members)
    np.testing.assert_allclose(step, 0.5 * np.mean([[1.0], [0.6], [0.2]] * z, axis=0), rtol=1e-5)


def test_snes_is_scaled_by_sigma_and_adds_utilities(z: NDArray[np.float32]) -> None:
    sigma = np.array([0.1, 0.2, 0.3, 0.4, 0.5], np.float32)
    members = scores([6.0, 5.0, 3.0], [1.0, 2.0, 4.0])
    # The best three of six have the utilities log 4 - log rank, over their sum; 1/6 cancels.
    best, second, third = np.log([4.0, 2.0, 4 / 3]) / np.log(4 * 2 * 4 / 3)
    step = RULES["snes"].step(hyperparameters(update="snes"), sigma, z, members)
    np.testing.assert_allclose(
        step, 0.5 * sigma * (np.array([best, second, -third]) @ z), rtol=1e-5
    )


@pytest.mark.parametrize("name", UPDATES)
def test_scores_that_are_not_finite_rank_last(name: str, z: NDArray[np.float32]) -> None:
    hp = hyperparameters(update=name)
    broken = RULES[name].step(hp, SIGMA, z, scores([np.nan, 3.0, 3.0], [9.0, -np.inf, 3.0], 3.0))
    assert np.isfinite(broken).all()
    assert broken @ z[0] < 0


def test_ties_in_the_order_of_the_members(z: NDArray[np.float32]) -> None:
    """Equal members get unequal weights with the authors' ties, and equal ones by mean rank."""
    members = scores([4.0, 4.0, 4.0])
    for ties, equal in (("mean", True), ("order", False)):
        hp = hyperparameters(update="authors", score_transform="nes-unnormalized", ties=ties)
        weights = RULES["authors"].weights(hp, members)
        assert bool(np.ptp(weights) == 0) is equal
