"""Runs that MLflow rejects, and documents that cannot be created."""

from pathlib import Path

import mlflow
import pytest

from bilevel import InvalidInput
from cluster.storage.home import Home
from cluster.storage.run_folder import Lifetime
from cluster.tracking import Document, Mirror, Point, RunView, Tracker


def fail() -> bytes:
    raise ValueError("broken")


OVER = Lifetime("FINISHED", 1.0, 2.0)
GOOD = Document.of("good.txt", "content")
BAD = Document("bad.png", "1", fail)
VIEWS = {
    "good": RunView("good", "good", OVER, {}, {}, documents=(GOOD,)),
    "broken": RunView("broken", "broken", OVER, {}, {}, documents=(GOOD, BAD)),
    "rejected": RunView("rejected", "rejected", OVER, {"a|b": 1}, {}),
}


def view_of(key: str) -> RunView:
    if key == "unreadable":
        raise InvalidInput("damaged file")
    return VIEWS[key]


@pytest.fixture
def tracker(tmp_path: Path) -> Tracker:
    return Tracker(f"sqlite:///{tmp_path}/mlflow.db", "task", Home(tmp_path))


def runs_of(tracker: Tracker) -> dict[str, mlflow.entities.Run]:
    client = mlflow.MlflowClient(tracker.uri)
    return {run.info.run_name: run for run in client.search_runs([tracker.experiment_id])}


def test_the_rest_is_written(tracker: Tracker) -> None:
    log: list[str] = []
    mirror = Mirror(tracker, view_of, log.append)
    mirror.mark(["rejected", "broken", "unreadable", "good"])
    assert mirror.close() == 3
    runs = runs_of(tracker)
    assert runs["good"].info.status == runs["broken"].info.status == "FINISHED"
    files = mlflow.MlflowClient(tracker.uri).list_artifacts(runs["broken"].info.run_id)
    assert [file.path for file in files] == ["good.txt"]
    rejected, broken, unreadable = log
    assert rejected.startswith("rejected: MLflow rejects the run (")
    assert broken == "broken: no bad.png (broken)"
    assert unreadable == "damaged file"


def test_points_are_appended_to_a_run_that_was_deleted_in_the_ui(tracker: Tracker) -> None:
    mirror = Mirror(tracker, VIEWS.__getitem__, print)
    tracker.show(VIEWS["good"])
    client = mlflow.MlflowClient(tracker.uri)
    client.delete_run(runs_of(tracker)["good"].info.run_id)
    mirror.append("good", [Point({"score": 1.0}, 0, 1.0)])
    assert mirror.close() == 0
    assert runs_of(tracker)["good"].info.status == "FINISHED"


def test_a_deleted_experiment_is_reported(tracker: Tracker) -> None:
    """MLflow would reject every run."""
    client = mlflow.MlflowClient(tracker.uri)
    client.delete_experiment(tracker.experiment_id)
    with pytest.raises(InvalidInput, match=r"experiment 'task' was deleted; restore it"):
        Tracker(tracker.uri, "task", tracker.home)
    client.restore_experiment(tracker.experiment_id)
    assert Tracker(tracker.uri, "task", tracker.home).experiment_id == tracker.experiment_id
