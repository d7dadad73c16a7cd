"""`bilevel sync`: write a run from disk to MLflow, also to an empty one."""

from pathlib import Path

from cluster.catalog.kinds import views_of
from cluster.session.terminal import Terminal, count
from cluster.storage.home import Home
from cluster.storage.run_folder import held
from cluster.tracking import Tracker
from cluster.tracking.connection import mlflow_errors


def sync(folder: Path, home: Home, tracking_uri: str, terminal: Terminal) -> None:
    """Write the parts of a run that MLflow lacks, from the run's files alone.

    The call may be repeated. Raises InvalidInput if the folder is damaged or in use by another
    process, or if MLflow fails or rejects a run.
    """
    with held(folder):
        views = views_of(folder)
        keys = views.keys()
        tracker = Tracker(tracking_uri, views.task_id, home)
        with terminal, mlflow_errors(tracking_uri):
            for done, key in enumerate(keys):
                terminal.bar("sync", done, len(keys), "runs")
                tracker.show(views.view(key))
        terminal.log(f"{folder.name}: {count(len(keys), 'run')} in MLflow now match the disk")
        terminal.log(f"MLflow {tracker.address(keys[0])}")
