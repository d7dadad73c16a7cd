"""What MLflow cannot be given does not keep the rest from it."""

import time
from pathlib import Path

import mlflow
import pytest

from bilevel import InvalidInput
from cluster.storage.run_folder import Lifetime
from cluster.tracking import Tracker
from cluster.tracking import mirror as mirrors
from cluster.tracking.mirror import Mirror
from cluster.tracking.view import Document, RunView


def fail() -> bytes:
    raise ValueError("one picture is broken")


OVER = Lifetime("FINISHED", 1.0, 2.0)
GOOD = Document.of_text("good.txt", "whole")
#: A run as MLflow takes it, one with a document that cannot be made, and one with a parameter of
#: a name that MLflow does not allow.
VIEWS = {
    "taken": RunView("taken", "taken", OVER, {}, {}, documents=(GOOD,)),
    "broken": RunView(
        "broken",
        "broken",
        OVER,
        {},
        {},
        documents=(Document("bad.png", "1", fail), GOOD),
    ),
    "refused": RunView("refused", "refused", OVER, {"a|b": 1}, {}),
}


@pytest.fixture
def tracker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Tracker:
    monkeypatch.setattr(mirrors, "_FIRST_RETRY", 0.05)
    return Tracker(f"sqlite:///{tmp_path}/mlflow.db", "task", tmp_path / "artifacts")


def names(tracker: Tracker) -> dict[str, mlflow.entities.Run]:
    client = mlflow.MlflowClient(tracker.uri)
    return {run.info.run_name: run for run in client.search_runs([tracker.experiment_id])}


def test_a_document_that_cannot_be_made_is_left_out(tracker: Tracker) -> None:
    told: list[str] = []
    mirror = Mirror(tracker, VIEWS.__getitem__, told.append)
    mirror.mark(["broken", "taken"])
    assert mirror.close() == 0
    runs = names(tracker)
    assert runs["broken"].info.status == runs["taken"].info.status == "FINISHED"
    files = mlflow.MlflowClient(tracker.uri).list_artifacts(runs["broken"].info.run_id)
    assert [file.path for file in files] == ["good.txt"]
    assert told == ["broken: MLflow lacks bad.png (one picture is broken)"]


def test_a_run_that_mlflow_does_not_take_lets_others_through(tracker: Tracker) -> None:
    told: list[str] = []
    mirror = Mirror(tracker, VIEWS.__getitem__, told.append)
    mirror.mark(["refused", "taken"])
    end = time.monotonic() + 60
    while not any("does not take" in line for line in told) and time.monotonic() < end:
        time.sleep(0.05)
    assert mirror.close() == 1
    assert names(tracker)["taken"].info.status == "FINISHED"
    (line,) = (line for line in told if "does not take" in line)
    assert line.startswith("refused: MLflow does not take the run (")


def test_a_deleted_experiment_is_told_at_once(tracker: Tracker) -> None:
    """MLflow would refuse each run, as if it could not be reached."""
    client = mlflow.MlflowClient(tracker.uri)
    client.delete_experiment(tracker.experiment_id)
    with pytest.raises(InvalidInput, match=r"experiment 'task' was deleted.* brings it back"):
        Tracker(tracker.uri, "task", Path())
    client.restore_experiment(tracker.experiment_id)
    assert Tracker(tracker.uri, "task", Path()).experiment_id == tracker.experiment_id
