"""The context of a run: its home, MLflow and Ray cluster."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ray

from cluster.ray.connection import (
    Capacity,
    is_own,
    ray_cluster,
    require_server_for_nodes,
    sharing,
)
from cluster.session.hints import tracking_option
from cluster.session.interrupts import InterruptGuard
from cluster.session.session import Session
from cluster.session.terminal import Terminal
from cluster.storage.home import Home, require_writable
from cluster.storage.run_folder import locked_settings
from cluster.tracking import Tracker
from cluster.tracking.connection import check_tracking_uri, mlflow_imported_meanwhile


@dataclass(frozen=True)
class RunContext:
    """Home, MLflow and Ray cluster; a resumed run may change all but the home."""

    home: Home
    tracking_uri: str
    address: str | None = None  # of a Ray cluster to join; None: start a local one
    tracking_given: bool = False  # the home alone does not tell the tracking URI

    @contextlib.contextmanager
    def connected(self, workers_per_trial: int = 1, trials: int = 1) -> Iterator["Driver"]:
        """Connect to Ray, and check MLflow, for the block; nothing is written.

        Raises InvalidInput for a home that cannot be written, for an invalid or unreachable MLflow
        or cluster, for a cluster that cannot place that many trials of so many one-core workers
        each, and for SQLite on several nodes.
        """
        require_writable(self.home.folder)
        check_tracking_uri(self.tracking_uri)
        if is_own(self.address):  # before it is started, which takes seconds
            Capacity.of_own().require(workers_per_trial, trials)
        with (
            Terminal() as terminal,
            mlflow_imported_meanwhile(),
            ray_cluster(self.address),
            InterruptGuard(terminal) as guard,  # after Ray, which installs its own SIGTERM handler
        ):
            capacity = Capacity.of_cluster()
            if capacity.cores:
                capacity.require(workers_per_trial)
            if workers_per_trial * trials > capacity.cores:
                what = "trials wait" if trials > 1 else "the run waits"
                terminal.log(
                    f"{workers_per_trial * trials} cores are asked for, the cluster has "
                    f"{capacity.cores}: {what} until others are free or join"
                )
            require_server_for_nodes(self.tracking_uri)
            if ray.available_resources().get("CPU", 0) < 1:
                terminal.log("all cores of the cluster are taken: waiting until one is free")
            with sharing():
                yield Driver(self, terminal, guard)

    @contextlib.contextmanager
    def offline(self) -> Iterator["Driver"]:
        """Check MLflow, for a block that needs no cluster. Raises InvalidInput as `connected`
        does."""
        check_tracking_uri(self.tracking_uri)
        with Terminal() as terminal, InterruptGuard(terminal) as guard:
            yield Driver(self, terminal, guard)

    def capacity(self) -> Capacity:
        """Cores and nodes that a run could use; no local cluster is started to find out. Raises
        InvalidInput as `connected` does."""
        if is_own(self.address):
            check_tracking_uri(self.tracking_uri)
            return Capacity.of_own()
        with self.connected():
            return Capacity.of_cluster()


@dataclass(frozen=True)
class Driver:
    """This process at work in a context: as a driver of the cluster, or offline."""

    context: RunContext
    terminal: Terminal
    guard: InterruptGuard
    #: By task. MLflow must be there when the first run begins; later ones go on without it.
    trackers: dict[str, Tracker] = field(default_factory=dict)

    @contextlib.contextmanager
    def session(self, folder: Path, task_id: str, settings: dict[str, Any]) -> Iterator[Session]:
        """Within the block this process holds the lock of the run in `folder`.

        Raises InvalidInput if the home cannot be written, if another process holds the lock,
        or if the run was begun with other settings.
        """
        home = self.context.home
        home.prepare()
        tracker = self._tracker(task_id)
        with locked_settings(folder, settings) as identity:
            if identity.mixture:
                self.terminal.log(f"{folder.name}: {identity.mixture}")
            options = tracking_option(tracker.uri) if self.context.tracking_given else ""
            yield Session(home, folder, identity, tracker, self.terminal, self.guard, options)

    def _tracker(self, task_id: str) -> Tracker:
        if task_id in self.trackers:
            return self.trackers[task_id].another()
        context = self.context
        first = Tracker(context.tracking_uri, task_id, context.home.artifacts)
        self.trackers[task_id] = first
        return first
