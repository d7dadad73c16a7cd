"""A run under way: its folder is held, it stands as running, and MLflow follows."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bilevel.errors import StorageFailure
from cluster.session.interrupts import InterruptGuard
from cluster.session.terminal import Terminal
from cluster.storage.run_folder import Begun, Standing, Status
from cluster.tracking import Mirror, Tracker, Views


@dataclass
class Session:
    """What every kind of run has at hand while a process works on it."""

    folder: Path
    begun: Begun
    tracker: Tracker
    terminal: Terminal
    guard: InterruptGuard
    #: How the run will stand if it ends without an error.
    status: Status = "FINISHED"

    def introduce(self, what: str) -> None:
        """Tell what is run, where it is kept, and where to look at it."""
        self.terminal.line(what)
        self.terminal.line(f"folder {self.folder}; to look at it: {self.tracker.address}")

    @contextlib.contextmanager
    def live(self, views: Views, target: int, goes_on: str) -> Iterator[Mirror]:
        """Within the block the run stands as RUNNING up to `target`, and MLflow shows those of
        its views that the mirror is told have changed; in the end both show how the block ended.

        After Ctrl-C the user is told how the run `goes_on`, and if MLflow lacks something even
        then, what to do about it.
        """
        self._stand("RUNNING", target)
        mirror = Mirror(self.tracker, views.view, self.terminal.line)
        mirror.mark(views.keys())  # what an earlier process did not get to show
        ended_as: Status = "FAILED"
        try:
            yield mirror
            ended_as = self.status
        except StorageFailure:
            ended_as = "KILLED"
            raise
        except KeyboardInterrupt:
            ended_as = "KILLED"
            self.terminal.line(f"stopped; {goes_on}")
            raise
        finally:
            with contextlib.suppress(StorageFailure):
                self._stand(ended_as, target)
            mirror.mark(views.keys())
            missing = mirror.close()
            if missing:
                self.terminal.line(
                    f"MLflow lacks {missing} run(s) as they are now: when it is back, "
                    f"`bilevel sync {self.folder.name}` writes them"
                )

    def _stand(self, status: Status, target: int) -> None:
        Standing(status, time.time(), target).save(self.folder)
