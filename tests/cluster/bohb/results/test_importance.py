from pathlib import Path

import ConfigSpace as CS
import numpy as np
import pytest

from cluster.bohb.results.importance import Importance, importance, unit_values
from cluster.bohb.results.pictures import hyperparameters
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal
from cluster.pictures import image
from tests.searches import search_of

SPACE = CS.ConfigurationSpace(
    space=[
        CS.Float("matters", (0.01, 1.0), log=True),
        CS.Float("hardly", (0.0, 1.0)),
        CS.Categorical("not", ("a", "b", "c")),
    ]
)


def searched(folder: Path, brackets: int, power: float | None = 1.0) -> Journal:
    """Random search of a power of a known objective; None is an objective that is noise."""
    rng = np.random.default_rng(0)
    search = search_of(SPACE, folder, brackets, schedule=Schedule((1,), 1), method="random")
    while (job := search.next_job()) is not None:
        hardly, matters, _ = unit_values(SPACE, job.configuration)
        known = np.exp((power or 0.0) * (10 * matters + hardly))
        search.register(job, float(rng.uniform() if power is None else known))
    return Journal(folder)


def test_importance_for_a_known_objective(tmp_path: Path) -> None:
    found = importance(SPACE, searched(tmp_path / "one", 60))
    assert found is not None
    mean = dict(zip(SPACE, found.mean, strict=True))
    assert mean["matters"] > 0.5
    assert mean["matters"] > 5 * mean["hardly"] > 5 * abs(mean["not"])
    assert (found.budget, found.results) == (1, 60)
    assert 0.8 < found.explained < 1
    other = importance(SPACE, searched(tmp_path / "other", 60, power=3.0))
    assert other is not None
    np.testing.assert_array_equal(other.mean, found.mean)  # ranks are equal


@pytest.mark.parametrize(
    ("results", "power", "enough"),
    [(0, 1.0, False), (9, 1.0, False), (20, 1.0, True), (40, None, False)],  # None is noise
)
def test_importance_needs_enough_results(
    results: int, power: float | None, enough: bool, tmp_path: Path
) -> None:
    assert (importance(SPACE, searched(tmp_path, results, power)) is not None) == enough


@pytest.mark.parametrize("bars", [2, 0])
def test_hyperparameters_are_drawn_with_and_without_importances(bars: int) -> None:
    tried, mean = np.random.default_rng(0).random((5, 2)), np.array([0.4, 0.1])
    found = Importance(mean, mean / 2, 3, 40, 0.5) if bars else None
    figure = hyperparameters(tried, tried[0], np.array([0.5, np.nan]), ("a", "b"), found, "study")
    assert len(figure.axes[1].patches) == bars
    assert image(figure)


def test_values_are_scaled_to_their_ranges() -> None:
    assert list(SPACE) == ["hardly", "matters", "not"]
    values = unit_values(SPACE, {"matters": 0.1, "hardly": 7.0, "not": "c"})
    np.testing.assert_allclose(values, [np.nan, 0.5, 1.0])
    assert np.isnan(unit_values(SPACE, {})).all()
