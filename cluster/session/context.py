"""The context of runs: home, MLflow and Ray cluster; and sessions, which work on one run each."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ray
from loky import cpu_count

from bilevel.errors import StorageFailure
from cluster.ray.connection import (
    cluster_cores,
    ray_cluster,
    require_cores,
    require_server_for_nodes,
)
from cluster.session.interrupts import InterruptGuard
from cluster.session.terminal import Terminal, count
from cluster.storage.author import without_password
from cluster.storage.home import Home, require_writable
from cluster.storage.run_folder import RunIdentity, RunStatus, Status, locked_settings
from cluster.tracking import Mirror, Tracker, Views
from cluster.tracking.connection import check_tracking_uri, preload_mlflow


@dataclass(frozen=True)
class RunContext:
    """Home, MLflow and Ray cluster. A resumed run may change all but the home."""

    home: Home
    tracking_uri: str
    address: str | None = None  # of a running Ray cluster; None starts a local one

    @contextlib.contextmanager
    def connected(self, workers_per_trial: int = 1, trials: int = 1) -> Iterator["Driver"]:
        """Connect to Ray and check MLflow. Nothing is written.

        Raises InvalidInput if one of them, the home or the number of workers is not usable.
        """
        require_writable(self.home.folder)
        check_tracking_uri(self.tracking_uri)
        if self.address is None:  # check before the start, which takes seconds
            require_cores(cpu_count(), workers_per_trial, trials)
        preload_mlflow()
        with (
            Terminal() as terminal,
            ray_cluster(self.address),
            InterruptGuard(terminal) as guard,  # after Ray, which installs its own SIGTERM handler
        ):
            needed = workers_per_trial * trials
            free = int(ray.available_resources().get("CPU", 0))
            if needed > free:
                terminal.log(
                    f"{needed} cores requested, {free} of the cluster's cores are free: waiting"
                )
            require_server_for_nodes(self.tracking_uri)
            yield Driver(self, terminal, guard)

    @contextlib.contextmanager
    def offline(self) -> Iterator["Driver"]:
        """Check MLflow for work that needs no cluster. Raises InvalidInput like `connected`."""
        check_tracking_uri(self.tracking_uri)
        with Terminal() as terminal, InterruptGuard(terminal) as guard:
            yield Driver(self, terminal, guard)

    def cores(self) -> int:
        """Return the cores that a run could use. Raises InvalidInput like `connected`."""
        if self.address is None:
            check_tracking_uri(self.tracking_uri)
            return int(cpu_count())
        with self.connected():
            return cluster_cores()


@dataclass(frozen=True)
class Driver:
    """This process while it works in a context, connected to the cluster or offline."""

    context: RunContext
    terminal: Terminal
    guard: InterruptGuard
    #: By task. MLflow must be reachable when the first run starts. Later runs tolerate failures.
    trackers: dict[str, Tracker] = field(default_factory=dict)

    @contextlib.contextmanager
    def session(self, folder: Path, task_id: str, settings: dict[str, Any]) -> Iterator["Session"]:
        """Hold the lock of the run in `folder` during the block. Raises InvalidInput if it is held
        by another process or was started with other settings."""
        home, uri = self.context.home, self.context.tracking_uri
        home.prepare()
        if task_id not in self.trackers:
            self.trackers[task_id] = Tracker(uri, task_id, home)
        with locked_settings(folder, settings) as identity:
            yield Session(folder, identity, self.trackers[task_id], self.terminal, self.guard)


@dataclass
class Session:
    """A run in progress: its folder is locked, its status is RUNNING, and MLflow follows."""

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
                home = self.tracker.home
                if self.tracker.uri != home.database_uri:
                    command += f" --tracking-uri {without_password(self.tracker.uri)}"
                self.terminal.log(
                    f"MLflow lacks the current state of {count(missing, 'run')}: once it is "
                    f"reachable, {home.hint(command)} writes them"
                )
