"""`bilevel sync`: MLflow shows a study again as it is on disk, an empty MLflow too."""

from pathlib import Path

from bilevel.errors import InvalidInput
from cluster.catalog.kinds import views_of
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from cluster.storage.run_folder import held
from cluster.tracking import Tracker
from cluster.tracking.tracker import check_tracking_uri, first_line


def sync(folder: Path, home: Home, tracking_uri: str, terminal: Terminal) -> None:
    """Bring MLflow to show the study or NES run in `folder`, from its files alone.

    What MLflow has already is left as it is, so this may be repeated. Raises
    InvalidInput if the folder is damaged or being worked on, or MLflow fails.
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
                except Exception as error:  # whatever MLflow has
                    raise InvalidInput(
                        f"MLflow at {tracking_uri!r} took {done} of {len(keys)} runs, then: "
                        f"{first_line(error)}; the same command goes on"
                    ) from None
        terminal.line(f"{folder.name}: {len(keys)} run(s) in MLflow are as on disk")
        terminal.line(f"to look at them: {tracker.address}")
