"""MLflow views of a study."""

from dataclasses import replace
from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import ConfigLine, Journal, ResultLine
from cluster.bohb.view import StudyViews, study_points
from cluster.storage.run_folder import RunStatus
from tests.studies import make_study


@pytest.fixture
def running(tmp_path: Path) -> StudyViews:
    """Views of a study of one bracket that continues."""
    make_study(tmp_path, 1)
    (tmp_path / "finals.jsonl").unlink()
    RunStatus("RUNNING", 0.0, 2).save(tmp_path)
    return StudyViews(tmp_path, live=True)


def test_only_running_configurations_have_the_status_running(running: StudyViews) -> None:
    """They get their artifacts at the end."""
    name = configuration_name(Journal(running.study.folder).configs[0].id)
    view = running.view(running.key(name))
    assert view.lifetime.status == "FINISHED"
    running.running.add(name)
    later = running.view(running.key(name))
    assert later.lifetime.status == "RUNNING"
    assert {d.path for d in later.documents} < {d.path for d in view.documents}


def test_pictures_of_a_running_study_are_updated_with_its_results(running: StudyViews) -> None:
    pictures = {"hyperparameters.png", "objective_against_cost.png"}

    def versions() -> set[str]:
        documents = running.view(running.parent).documents
        return {document.version for document in documents if document.path in pictures}

    before = versions()
    journal = Journal(running.study.folder)
    last = journal.results[-1]
    journal.add_result(replace(last, budget=last.budget * 3))
    assert len(versions() | before) == 2


def test_points_of_the_best_objective_over_time(tmp_path: Path) -> None:
    study = make_study(tmp_path, 5)
    summary = StudySummary.of(Journal(tmp_path), study.schedule.brackets(5))
    points = study_points(summary)
    led = [(p.step, p.values["objective"]) for p in points if "objective" in p.values]
    assert led == [(number, line.loss) for number, line in summary.leaders()]
    assert len(led) > 1
    for budget in study.schedule.budgets:
        name = f"best_at_{budget}"
        best = [point.values[name] for point in points if name in point.values]
        assert best == sorted(best, reverse=True)
        assert best[-1] == min(r.objective for r in summary.journal.results if r.budget == budget)


def test_an_invalid_configuration_is_shown_with_its_error(tmp_path: Path) -> None:
    make_study(tmp_path, brackets=1)
    journal = Journal(tmp_path)
    journal.add_config(ConfigLine((7, 0, 0), {"nes.averaging": 0.9999}, {}))
    views = StudyViews(tmp_path)
    key = views.keys()[-1]
    with pytest.raises(InvalidInput, match=r"nes\.averaging: must be"):
        views.view(key)
    now = {"submitted": 1.0, "started": 1.0, "finished": 2.0}
    journal.add_result(ResultLine((7, 0, 0), 1, None, {}, now, "Traceback\nInvalidInput: no"))
    view = views.view(key)
    assert view.lifetime.status == "FAILED"
    assert view.tags["bilevel.error"] == "InvalidInput: no"
    assert view.params == {"nes.averaging": 0.9999}
