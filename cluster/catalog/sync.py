"""`bilevel sync`: write a run from disk to MLflow, also to an empty one."""

from pathlib import Path

from bilevel.errors import InvalidInput, first_line
from cluster.catalog.kinds import views_of
from cluster.session.session import shown_at
from cluster.session.terminal import Terminal
from cluster.storage.author import without_password
from cluster.storage.home import Home
from cluster.storage.run_folder import held
from cluster.tracking import Tracker
from cluster.tracking.tracker import check_tracking_uri
from cluster.tracking.view import DocumentFailed


def sync(folder: Path, home: Home, tracking_uri: str, terminal: Terminal) -> None:
    """Write what MLflow lacks of the run in `folder`, from its files alone.

    The call may be repeated. Raises InvalidInput if the folder is damaged or in use by another
    process, or if MLflow fails.
    """
    check_tracking_uri(tracking_uri)
    with held(folder):
        views = views_of(folder)
        keys = views.keys()
        tracker = Tracker(tracking_uri, views.task_id, home.artifacts, thorough=True)
        with terminal:
            for done, key in enumerate(keys):
                view = views.view(key)
                terminal.bar(f"sync {view.name}", done, len(keys), "runs")
                try:
                    tracker.show(view)
                except DocumentFailed as error:
                    terminal.log(f"{view.name}: MLflow lacks {error}")
                except Exception as error:  # MLflow raises errors of many kinds
                    raise InvalidInput(
                        f"MLflow at {without_password(tracking_uri)} failed after {done} of "
                        f"{len(keys)} runs: {without_password(first_line(error))}; run the same "
                        "command again to resume"
                    ) from None
        terminal.log(f"{folder.name}: {len(keys)} run(s) in MLflow now match the disk")
        terminal.log(f"MLflow {shown_at(home, tracker, keys[0])}")
