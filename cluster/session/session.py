"""A run in progress: its folder is locked, its status is RUNNING, and MLflow follows."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bilevel.errors import StorageFailure
from cluster.session.interrupts import InterruptGuard
from cluster.session.terminal import Terminal, count
from cluster.storage.author import without_password
from cluster.storage.home import Home
from cluster.storage.run_folder import RunIdentity, RunStatus, Status
from cluster.tracking import Mirror, Tracker, Views


@dataclass
class Session:
    """Folder, tracker, terminal and signals of a run while a process works on it."""

    home: Home
    folder: Path
    identity: RunIdentity
    tracker: Tracker
    terminal: Terminal
    guard: InterruptGuard
    #: Status of the run if it ends without an error.
    status: Status = "FINISHED"

    def introduce(self, description: str) -> None:
        """Print a description of the run, its folder, and its MLflow address."""
        self.terminal.log(description)
        self.terminal.log(f"folder {self.folder}")
        self.terminal.log(f"MLflow {self.tracker.address()}")

    @property
    def address(self) -> str:
        """The address of the run in MLflow."""
        return self.tracker.address(self.identity.uuid)

    @contextlib.contextmanager
    def live(self, views: Views, target: int, resume_hint: str) -> Iterator[Mirror]:
        """Set the run's status to RUNNING with `target`, and mirror changed views to MLflow, during
        the block. At the end record how the block ended.

        Messages suggest how to resume after Ctrl-C and how to complete MLflow.
        """
        RunStatus("RUNNING", time.time(), target).save(self.folder)
        mirror = Mirror(self.tracker, views.view, self.terminal.log)
        mirror.mark(views.keys())  # an earlier process may have missed some
        result: Status = "FAILED"
        try:
            yield mirror
            result = self.status
        except (StorageFailure, KeyboardInterrupt) as error:
            result = "KILLED"
            if isinstance(error, KeyboardInterrupt) and not self.guard.explained:
                self.guard.explained = True  # runs around this one lose no more
                self.terminal.log(f"interrupted; {resume_hint}")
            raise
        finally:
            with contextlib.suppress(StorageFailure):
                RunStatus(result, time.time(), target).save(self.folder)
            mirror.mark(views.keys())
            missing = mirror.close()
            if missing:
                command = f"sync {self.folder.parent.name}/{self.folder.name}"
                if self.tracker.uri != self.home.database_uri:
                    command += f" --tracking-uri {without_password(self.tracker.uri)}"
                self.terminal.log(
                    f"MLflow lacks the current state of {count(missing, 'run')}: once it is "
                    f"reachable, {self.home.hint(command)} writes them"
                )
