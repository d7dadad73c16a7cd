"""What MLflow shows of a study."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bilevel import InvalidInput
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.validation import Validation
from cluster.bohb.study.definition import SPACE_FILE, configuration_name
from cluster.bohb.study.journal import ConfigLine, Journal, ResultLine
from cluster.bohb.view import StudyViews, _way, hyperparameter_picture
from cluster.storage.run_folder import RunStatus
from tests.studies import make_study


def running(folder: Path, brackets: int) -> StudyViews:
    """Views of a study that has run so many brackets and goes on."""
    make_study(folder, brackets)
    (folder / "finals.jsonl").unlink()
    RunStatus("RUNNING", 0.0, brackets + 1).save(folder)
    return replace(StudyViews.of(folder), live=True)


def drawn_at(views: StudyViews) -> str:
    """What the picture of the hyperparameters shows."""
    documents = {one.path: one.version for one in views.view(views.parent).documents}
    return documents["hyperparameters.png"]


def test_hyperparameters_are_drawn_now_and_then_and_in_full_once_it_stops(tmp_path: Path) -> None:
    views = running(tmp_path, brackets=5)
    number = len(Journal(tmp_path).results)
    assert 10 < number < 20
    assert drawn_at(views) == "10 results"
    assert drawn_at(replace(views, live=False)) == f"{number} results"


def test_a_configuration_runs_while_the_study_says_so(tmp_path: Path) -> None:
    views = running(tmp_path, brackets=1)
    line = next(line for line in Journal(tmp_path).configs)
    name = configuration_name(line.id)
    best = {one.path for one in views.view(views.key(name)).documents}
    assert views.view(views.key(name)).lifetime.status == "FINISHED"
    views.running.add(name)
    assert views.view(views.key(name)).lifetime.status == "RUNNING"
    assert best > {one.path for one in views.view(views.key(name)).documents}  # at its end


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


def test_the_incumbent_over_time(tmp_path: Path) -> None:
    """Each change of the leader, and at each budget the best so far, which never rises."""
    study = make_study(tmp_path, 5)
    views = StudyViews.of(tmp_path)
    points = views.view(views.parent).points
    summary = StudySummary.of(Journal(tmp_path), study.schedule.brackets(5))
    led = [(p.step, p.values["objective"]) for p in points if "objective" in p.values]
    assert led == [(number, line.loss) for number, line in summary.leaders()]
    assert len(led) > 1
    for budget in study.schedule.budgets:
        name = f"best_at_{budget}"
        best = [point.values[name] for point in points if name in point.values]
        assert best == sorted(best, reverse=True)
        results = Journal(tmp_path).results
        assert best[-1] == min(r.objective for r in results if r.budget == budget)


def test_the_best_configurations_are_those_that_went_on(tmp_path: Path) -> None:
    study = make_study(tmp_path, 5)
    summary = StudySummary.of(Journal(tmp_path), study.schedule.brackets(5))
    results = [summary.result_of(one) for one in summary.ranked]
    assert len(results) == len(summary.journal.configs)
    assert [line.budget for line in results] == sorted((r.budget for r in results), reverse=True)
    assert summary.leader is not None
    assert summary.ranked[0] == summary.leader.id


def test_a_study_is_drawn_over_the_ranges_that_it_began_with(tmp_path: Path) -> None:
    """Those of the package may have changed since."""
    study = make_study(tmp_path, brackets=1)
    study.write_space()
    path = tmp_path / SPACE_FILE
    stored = json.loads(path.read_text())
    (changed,) = [d for d in stored["hyperparameters"] if d["name"] == "nes.std_dev"]
    changed["upper"] *= 2
    path.write_text(json.dumps(stored))
    assert study.stored_space()["nes.std_dev"].to_value(1.0) == pytest.approx(changed["upper"])
    summary = StudySummary.of(Journal(tmp_path), study.schedule.brackets(1))
    places = hyperparameter_picture(study, summary).axes[0]
    row = [label.get_text() for label in places.get_yticklabels()].index("nes.std_dev")
    (drawn,) = [
        np.asarray(artist.get_offsets(), np.float64)
        for artist in places.collections
        if len(np.asarray(artist.get_offsets())) == len(summary.ranked)
        and {y for _, y in np.asarray(artist.get_offsets())} == {row}
    ]
    values = [summary.configuration(one)["nes.std_dev"] for one in reversed(summary.ranked)]
    ends = np.log([changed["lower"], changed["upper"]])
    np.testing.assert_allclose(drawn[:, 0], (np.log(values) - ends[0]) / np.ptp(ends))


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
