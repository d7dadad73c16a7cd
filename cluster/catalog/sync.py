"""`bilevel sync`: write a run from disk to MLflow, also to an empty one."""

from pathlib import Path

from bilevel.errors import InvalidInput
from cluster.catalog.kinds import views_of
from cluster.session.session import shown_at
from cluster.session.terminal import Terminal, count
from cluster.storage.author import without_password
from cluster.storage.home import Home
from cluster.storage.run_folder import held
from cluster.tracking import Tracker
from cluster.tracking.connection import mlflow_errors
from cluster.tracking.tracker import Incomplete


def sync(folder: Path, home: Home, tracking_uri: str, terminal: Terminal) -> None:
    """Write the parts of a run that MLflow lacks, from the run's files alone.

    The call may be repeated. It logs runs that MLflow rejects and documents that cannot be created,
    and then raises InvalidInput at the end. It raises InvalidInput at once if the folder is damaged
    or in use by another process, or if MLflow fails.
    """
    with held(folder):
        views = views_of(folder)
        keys = views.keys()
        tracker = Tracker(tracking_uri, views.task_id, home.artifacts)
        incomplete = 0
        with terminal, mlflow_errors(tracking_uri):
            for done, key in enumerate(keys):
                view = views.view(key)
                terminal.bar(f"sync {view.name}", done, len(keys), "runs")
                try:
                    tracker.show(view)
                except Incomplete as error:
                    terminal.log(str(error))
                    incomplete += 1
        terminal.log(f"MLflow {shown_at(home, tracker, keys[0])}")
    complete = f"{len(keys) - incomplete} of {count(len(keys), 'run')} of {folder.name!r}"
    if incomplete:
        raise InvalidInput(
            f"synced only {complete} completely to MLflow at {without_password(tracking_uri)}; see "
            "the errors above"
        )
    terminal.log(f"{complete} in MLflow now match the disk")
