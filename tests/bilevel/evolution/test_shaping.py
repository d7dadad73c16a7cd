import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import rankdata

from bilevel.evolution.shaping import transform
from bilevel.hyperparameters import SCORE_TRANSFORMS

SCORES = np.array([10.0, 40.0, 20.0, 30.0])

scores = arrays(
    np.float64, st.integers(1, 30), elements=st.floats(-1e4, 1e4, allow_subnormal=False)
)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("linear", [0, 1, 1 / 3, 2 / 3]),
        ("rank", [0, 1, 1 / 3, 2 / 3]),
        ("nes", [-0.520375, 1, -0.520375, 0.04075]),
        ("nes-unnormalized", [0, 1, 0, np.log(1.5) / np.log(3)]),
        ("single-best", [0, 1, 0, 0]),
        ("single-better-average", [0, 1, 0, 0]),
        ("better-average", [0, 1, 0, 0.5]),
        ("better-average-sum", [0, 2 / 3, 0, 1 / 3]),
    ],
)
def test_by_hand(name: str, expected: list[float]) -> None:
    np.testing.assert_allclose(transform(name, SCORES, 20.0), expected, atol=1e-6)


@given(score=st.floats(-500, 500), agents=st.integers(1, 40))
def test_equal_scores_are_not_better_than_their_mean(score: float, agents: int) -> None:
    """The last bits of a mean may be lower."""
    average = float(np.full(agents, score).mean())
    for name in ("single-better-average", "better-average", "better-average-sum"):
        assert not transform(name, np.full(4, score), average).any()
        assert transform(name, np.array([score, score + 1e-4]), average)[1] == 1


@pytest.mark.parametrize("name", SCORE_TRANSFORMS)
def test_non_finite_scores_rank_last(name: str) -> None:
    broken = np.array([np.nan, 3.0, -np.inf, 5.0, np.inf])
    weights = transform(name, broken, 0.0)
    assert np.isfinite(weights).all()
    assert weights[3] == weights.max()
    for i in (0, 2, 4):
        assert weights[i] == weights.min()


@pytest.mark.parametrize("name", SCORE_TRANSFORMS)
@given(values=scores, average=st.floats(-1e4, 1e4))
def test_monotone_finite_and_at_most_one(name: str, values: np.ndarray, average: float) -> None:
    weights = transform(name, values, average)
    assert np.isfinite(weights).all()
    assert weights.max() <= 1 + 1e-12
    order = np.argsort(values, kind="stable")
    if "single" not in name:
        assert (np.diff(weights[order]) >= -1e-12).all()


@pytest.mark.parametrize(("ties", "method"), [("mean", "average"), ("order", "ordinal")])
@given(values=scores)
def test_ranks_equal_those_of_scipy(ties: str, method: str, values: np.ndarray) -> None:
    values = np.round(values / 1000)  # makes ties
    expected = (rankdata(values, method=method) - 1) / max(values.size - 1, 1)
    np.testing.assert_array_equal(transform("rank", values, 0.0, ties), expected)
