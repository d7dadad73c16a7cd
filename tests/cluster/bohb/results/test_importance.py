"""The importance of hyperparameters is that of a known objective."""

from pathlib import Path

import ConfigSpace as CS
import numpy as np
import pytest
from matplotlib.figure import Figure

from cluster.bohb.results import pictures
from cluster.bohb.results.importance import Importance, importance, unit_values
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal
from cluster.pictures import ORANGE, png

SPACE = CS.ConfigurationSpace(
    space=[
        CS.Float("matters", (0.01, 1.0), log=True),
        CS.Float("hardly", (0.0, 1.0)),
        CS.Categorical("not", ("a", "b", "c")),
    ]
)


def searched(folder: Path, brackets: int, power: float = 1.0) -> Journal:
    """A random search of an objective that is known, or of a power of it."""
    journal = Journal(folder)
    search = BracketSearch(SPACE, Schedule((1,), 1), brackets, 0, journal, model=False)
    while (job := search.next_job()) is not None:
        values = unit_values(SPACE, job.configuration)
        search.register(job, float(np.exp(power * (10 * values[1] + values[0]))))
    return journal


def test_of_a_known_objective(tmp_path: Path) -> None:
    found = importance(SPACE, searched(tmp_path / "one", 60))
    assert found is not None
    mean = dict(zip(found.names, found.mean, strict=True))
    assert mean["matters"] > 0.5
    assert mean["matters"] > 5 * mean["hardly"] > 5 * abs(mean["not"])
    assert (found.budget, found.results) == (1, 60)
    assert 0.8 < found.explained < 1
    # Ranks alone count.
    other = importance(SPACE, searched(tmp_path / "other", 60, power=3.0))
    assert other is not None
    np.testing.assert_array_equal(other.mean, found.mean)


def test_too_few_results_tell_nothing(tmp_path: Path) -> None:
    assert importance(SPACE, Journal(tmp_path / "none")) is None
    assert importance(SPACE, searched(tmp_path / "few", 9)) is None
    assert importance(SPACE, searched(tmp_path / "enough", 10)) is not None


def test_a_forest_that_predicts_nothing_shows_no_importance(tmp_path: Path) -> None:
    journal, random = Journal(tmp_path), np.random.default_rng(0)
    search = BracketSearch(SPACE, Schedule((1,), 1), 40, 0, journal, model=False)
    while (job := search.next_job()) is not None:
        search.register(job, float(random.uniform()))
    found = importance(SPACE, journal)
    assert found is not None
    assert found.explained <= 0
    bars = drawn(journal, found).axes[1]
    assert not bars.patches
    assert "tells nothing" in bars.get_title()


def test_values_on_the_unit_interval() -> None:
    values = unit_values(SPACE, {"matters": 0.1, "hardly": 7.0, "not": "c"})
    assert list(SPACE) == ["hardly", "matters", "not"]
    np.testing.assert_allclose(values, [np.nan, 0.5, 1.0])
    assert np.isnan(unit_values(SPACE, {})).all()


def drawn(journal: Journal, found: Importance | None) -> Figure:
    """The picture, with the first two configurations as those that led."""
    tried = np.array([unit_values(SPACE, line.configuration) for line in journal.configs])
    recipe = unit_values(SPACE, {"matters": 0.02, "hardly": 0.3, "not": "a"})
    return pictures.hyperparameters(tried, tried[:2], recipe, tuple(SPACE), found, "a study")


@pytest.mark.parametrize("results", [2, 40])
def test_the_picture(results: int, tmp_path: Path) -> None:
    journal = searched(tmp_path, results)
    found = importance(SPACE, journal)
    figure = drawn(journal, found)
    places, bars = figure.axes[:2]
    assert [label.get_text() for label in places.get_yticklabels()] == list(SPACE)
    assert len(bars.patches) == (len(SPACE) if found else 0)
    # The way of each hyperparameter: from the recipe to the first, and on to the second.
    way = [line for line in places.lines if line.get_color() == ORANGE]
    assert len(way) == 2 * len(SPACE)
    first = unit_values(SPACE, journal.configs[0].configuration)
    ends = np.array([line.get_xdata() for line in way[: len(SPACE)]], np.float64)[:, 1]
    np.testing.assert_allclose(ends, first)
    assert len(png(figure)) > 1000
