"""What MLflow shows of a study."""

from dataclasses import replace
from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.bohb.journal import ConfigLine, Journal, ResultLine
from cluster.bohb.summary import StudySummary
from cluster.bohb.validation import Validation
from cluster.bohb.view import StudyViews, _way
from cluster.storage.run_folder import RunStatus
from tests.studies import make_study


def running(folder: Path, brackets: int) -> StudyViews:
    """Views of a study that has run so many brackets and goes on."""
    make_study(folder, brackets)
    (folder / "finals.jsonl").unlink()
    RunStatus("RUNNING", 0.0, brackets + 1).save(folder)
    return replace(StudyViews.of(folder), live=())


def drawn_at(views: StudyViews) -> str:
    """What the picture of the hyperparameters shows."""
    documents = {one.path: one.version for one in views.view(views.parent).documents}
    return documents["hyperparameters.png"]


def test_hyperparameters_are_drawn_now_and_then_and_in_full_once_it_stops(tmp_path: Path) -> None:
    views = running(tmp_path, brackets=5)
    number = len(Journal(tmp_path).results)
    assert 10 < number < 20
    assert drawn_at(views) == "10 results"
    assert drawn_at(replace(views, live=None)) == f"{number} results"


def test_the_first_results_are_drawn_at_once(tmp_path: Path) -> None:
    views = running(tmp_path, brackets=1)
    number = len(Journal(tmp_path).results)
    assert number < 10
    assert drawn_at(views) == f"{number} results"


def test_the_way_ends_at_the_incumbent(tmp_path: Path) -> None:
    """Which is the winner of a validation, whoever led in the search."""
    study = make_study(tmp_path)
    summary = StudySummary.of(Journal(tmp_path), study.schedule.brackets(2))
    leader = summary.leader
    assert leader is not None
    way = _way(summary)
    assert way[-1] == leader.id
    other = next(line for line in Journal(tmp_path).results if line.id != leader.id)
    validated = replace(summary, validation=Validation(6, (other, leader)))
    assert _way(validated) == [*way, other.id]


def test_a_configuration_that_was_never_allowed_is_shown_with_its_failure(tmp_path: Path) -> None:
    make_study(tmp_path, brackets=1)
    journal = Journal(tmp_path)
    journal.add_config(ConfigLine((7, 0, 0), {"nes.averaging": 0.9999}, {}))
    views = StudyViews.of(tmp_path)
    key = views.keys()[-1]
    with pytest.raises(InvalidInput, match="averaging must be"):
        views.view(key)
    now = {"submitted": 1.0, "started": 1.0, "finished": 2.0}
    journal.add_result(ResultLine((7, 0, 0), 1, None, {}, now, "Traceback\nInvalidInput: no"))
    view = views.view(key)
    assert view.lifetime.status == "FAILED"
    assert view.tags["bilevel.error"] == "InvalidInput: no"
    assert view.params == {"nes.averaging": 0.9999}
