"""The importance of hyperparameters is that of a known objective."""

from pathlib import Path

import ConfigSpace as CS
import numpy as np
import pytest

from cluster.bohb import pictures
from cluster.bohb.brackets import Schedule
from cluster.bohb.importance import importance, unit_values
from cluster.bohb.journal import Journal
from cluster.bohb.search import BracketSearch
from cluster.pictures import png

SPACE = CS.ConfigurationSpace(
    space=[
        CS.Float("matters", (0.01, 1.0), log=True),
        CS.Float("hardly", (0.0, 1.0)),
        CS.Categorical("not", ("a", "b", "c")),
    ]
)


def searched(folder: Path, brackets: int) -> Journal:
    """A random search of an objective that is known."""
    journal = Journal(folder)
    search = BracketSearch(SPACE, Schedule((1,), 1), brackets, 0, journal, model=False)
    while (job := search.next_job()) is not None:
        values = unit_values(SPACE, job.configuration)
        search.register(job, float(np.exp(10 * values[1] + values[0])))
    return journal


def test_of_a_known_objective(tmp_path: Path) -> None:
    found = importance(SPACE, searched(tmp_path, 60))
    assert found is not None
    mean = dict(zip(found.names, found.mean, strict=True))
    assert mean["matters"] > 1
    assert mean["matters"] > 5 * mean["hardly"] > 5 * abs(mean["not"])
    assert (found.budget, found.results) == (1, 60)
    assert 0.9 < found.out_of_bag < 1


def test_too_few_results_tell_nothing(tmp_path: Path) -> None:
    assert importance(SPACE, Journal(tmp_path / "none")) is None
    assert importance(SPACE, searched(tmp_path / "few", 9)) is None
    assert importance(SPACE, searched(tmp_path / "enough", 10)) is not None


def test_values_on_the_unit_interval() -> None:
    values = unit_values(SPACE, {"matters": 0.1, "hardly": 7.0, "not": "c"})
    assert list(SPACE) == ["hardly", "matters", "not"]
    np.testing.assert_allclose(values, [np.nan, 0.5, 1.0])
    assert np.isnan(unit_values(SPACE, {})).all()


@pytest.mark.parametrize("results", [1, 40])
def test_the_picture(results: int, tmp_path: Path) -> None:
    journal = searched(tmp_path, results)
    tried = np.array([unit_values(SPACE, line.configuration) for line in journal.configs])
    objectives = np.array([line.loss for line in journal.results], np.float64)
    recipe = unit_values(SPACE, {"matters": 0.02, "hardly": 3.0, "not": "a"})
    found = importance(SPACE, journal)
    figure = pictures.hyperparameters(
        tried, objectives, tried[:1], recipe, tuple(SPACE), found, "a study"
    )
    places, bars = figure.axes[:2]
    assert [label.get_text() for label in places.get_yticklabels()] == list(SPACE)
    assert len(bars.patches) == (len(SPACE) if found else 0)
    assert len(png(figure)) > 1000
