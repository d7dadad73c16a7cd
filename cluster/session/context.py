"""The context of a run: its home, MLflow and Ray cluster."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ray

from cluster.ray.connection import Capacity, ray_cluster, require_server_for_nodes, sharing
from cluster.session.hints import tracking_option
from cluster.session.interrupts import InterruptGuard
from cluster.session.session import Session
from cluster.session.terminal import Terminal
from cluster.storage.home import Home, require_writable
from cluster.storage.run_folder import locked_settings
from cluster.tracking import Tracker
from cluster.tracking.connection import check_tracking_uri, preload_mlflow


@dataclass(frozen=True)
class RunContext:
    """Home, MLflow and Ray cluster. A resumed run may change all but the home."""

    home: Home
    tracking_uri: str
    address: str | None = None  # of a running Ray cluster; None starts a local one
    tracking_given: bool = False  # whether suggested commands need the tracking URI

    @contextlib.contextmanager
    def connected(self, workers_per_trial: int = 1, trials: int = 1) -> Iterator["Driver"]:
        """Connect to Ray and check MLflow. Nothing is written.

        Raises InvalidInput if the home is not writable, MLflow or the cluster is invalid or
        unreachable, no trial fits into the cluster, all trials do not fit into a local cluster, or
        several nodes would share an SQLite database.
        """
        require_writable(self.home.folder)
        check_tracking_uri(self.tracking_uri)
        if self.address is None:  # check before the start, which takes seconds
            Capacity.of_own().require(workers_per_trial, trials)
        preload_mlflow()
        with (
            Terminal() as terminal,
            ray_cluster(self.address),
            InterruptGuard(terminal) as guard,  # after Ray, which installs its own SIGTERM handler
        ):
            capacity = Capacity.of_cluster()
            if capacity.cores:
                capacity.require(workers_per_trial)
            needed = workers_per_trial * trials
            if needed > capacity.cores:
                terminal.log(
                    f"{needed} cores requested, but the cluster has {capacity.cores}: waiting "
                    "until cores become free or nodes join"
                )
            elif ray.available_resources().get("CPU", 0) < 1:
                terminal.log("all cores of the cluster are busy: waiting until one is free")
            require_server_for_nodes(self.tracking_uri)
            with sharing():
                yield Driver(self, terminal, guard)

    @contextlib.contextmanager
    def offline(self) -> Iterator["Driver"]:
        """Check MLflow for work that needs no cluster. Raises InvalidInput like `connected`."""
        check_tracking_uri(self.tracking_uri)
        with Terminal() as terminal, InterruptGuard(terminal) as guard:
            yield Driver(self, terminal, guard)

    def capacity(self) -> Capacity:
        """Return the cores that a run could use, without starting a local cluster. Raises
        InvalidInput like `connected`."""
        if self.address is None:
            check_tracking_uri(self.tracking_uri)
            return Capacity.of_own()
        with self.connected():
            return Capacity.of_cluster()


@dataclass(frozen=True)
class Driver:
    """This process while it works in a context, connected to the cluster or offline."""

    context: RunContext
    terminal: Terminal
    guard: InterruptGuard
    #: By task. MLflow must be reachable when the first run starts. Later runs tolerate failures.
    trackers: dict[str, Tracker] = field(default_factory=dict)

    @contextlib.contextmanager
    def session(self, folder: Path, task_id: str, settings: dict[str, Any]) -> Iterator[Session]:
        """Hold the lock of the run in `folder` during the block.

        Raises InvalidInput if the home is not writable, another process holds the lock, or the run
        was started with other settings.
        """
        home, uri = self.context.home, self.context.tracking_uri
        home.prepare()
        known = self.trackers.get(task_id)
        tracker = known.another() if known else Tracker(uri, task_id, home.artifacts)
        self.trackers.setdefault(task_id, tracker)
        with locked_settings(folder, settings) as identity:
            if identity.mixture:
                self.terminal.log(f"{folder.name}: {identity.mixture}")
            options = tracking_option(tracker.uri) if self.context.tracking_given else ""
            yield Session(home, folder, identity, tracker, self.terminal, self.guard, options)
