"""`bilevel sync`: write a run from disk to MLflow, also to an empty one."""

from pathlib import Path

from bilevel.errors import InvalidInput, first_line
from cluster.catalog.kinds import views_of
from cluster.session.session import shown_at
from cluster.session.terminal import Terminal, count
from cluster.storage.author import without_password
from cluster.storage.home import Home
from cluster.storage.run_folder import held
from cluster.tracking import Tracker
from cluster.tracking.connection import check_tracking_uri
from cluster.tracking.view import DocumentFailed

#: Runs that MLflow refuses one after the other until it is taken to be out of order.
_REFUSED_IN_A_ROW = 2


def sync(folder: Path, home: Home, tracking_uri: str, terminal: Terminal) -> None:
    """Write what MLflow lacks of the run in `folder`, from its files alone.

    The call may be repeated. A run that MLflow does not take, and a document that cannot be made,
    are named and left out. Raises InvalidInput at the end if there were any, and at once if the
    folder is damaged or in use by another process, or if MLflow fails.
    """
    check_tracking_uri(tracking_uri)
    shown = without_password(tracking_uri)
    with held(folder):
        views = views_of(folder)
        keys = views.keys()
        tracker = Tracker(tracking_uri, views.task_id, home.artifacts, thorough=True)
        incomplete, refused = 0, 0
        with terminal:
            for done, key in enumerate(keys):
                view = views.view(key)
                terminal.bar(f"sync {view.name}", done, len(keys), "runs")
                try:
                    tracker.show(view)
                    refused = 0
                except DocumentFailed as error:
                    terminal.log(f"{view.name}: MLflow lacks {error}")
                    incomplete, refused = incomplete + 1, 0
                except Exception as error:  # MLflow raises errors of many kinds
                    reason = without_password(first_line(error))
                    incomplete, refused = incomplete + 1, refused + 1
                    if refused == min(_REFUSED_IN_A_ROW, len(keys)):
                        raise InvalidInput(
                            f"MLflow at {shown} failed after {done} of {len(keys)} runs: {reason}; "
                            "run the same command again to resume"
                        ) from None
                    terminal.log(f"{view.name}: MLflow does not take the run ({reason})")
                    tracker.forget()
        terminal.log(
            f"{folder.name}: {len(keys) - incomplete} of {count(len(keys), 'run')} in MLflow now "
            "match the disk"
        )
        terminal.log(f"MLflow {shown_at(home, tracker, keys[0])}")
    if incomplete:
        raise InvalidInput(
            f"MLflow at {shown} lacks {count(incomplete, 'run')} of {folder.name!r}, or parts of "
            "them, for the reasons told above"
        )
