"""What MLflow shows of a study."""

from dataclasses import replace
from pathlib import Path

from cluster.bohb.journal import Journal
from cluster.bohb.view import StudyViews
from cluster.storage.run_folder import RunStatus
from tests.studies import make_study


def running(folder: Path, brackets: int) -> StudyViews:
    """Views of a study that has run so many brackets and goes on."""
    make_study(folder, brackets)
    (folder / "finals.json").unlink()
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
