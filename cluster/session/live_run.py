"""What holds while something is being run: it stands as running, and MLflow follows."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bilevel.errors import StorageFailure
from cluster.session.terminal import Terminal
from cluster.storage.run_folder import Standing, Status
from cluster.tracking import Mirror, Tracker, Views


@dataclass
class LiveRun:
    """A run under way. `mirror` is told what changes; `status` is how it will stand if
    it ends without an error."""

    mirror: Mirror
    status: Status = "FINISHED"


@contextlib.contextmanager
def live_run(
    folder: Path, target: int, views: Views, tracker: Tracker, terminal: Terminal
) -> Iterator[LiveRun]:
    """Within the block the folder stands as RUNNING up to `target`, and MLflow shows the
    views as they change; in the end both show how the block ended.

    What MLflow lacks even then is told, with what to do about it.
    """

    def stand(status: Status) -> None:
        Standing(status, time.time(), target).save(folder)

    stand("RUNNING")
    run = LiveRun(Mirror(tracker, views.view, terminal.line))
    run.mirror.mark(views.keys())  # what an earlier process did not get to show
    status: Status = "FAILED"
    try:
        yield run
        status = run.status
    except (StorageFailure, KeyboardInterrupt):
        status = "KILLED"
        raise
    finally:
        with contextlib.suppress(StorageFailure):
            stand(status)
        run.mirror.mark(views.keys())
        missing = run.mirror.close()
        if missing:
            terminal.line(
                f"MLflow lacks {missing} run(s) as they are now: when it is back, "
                f"`bilevel sync {folder.name}` writes them"
            )
