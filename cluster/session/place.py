"""Home, MLflow and Ray cluster of one command."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ray

from cluster.ray.connection import ray_cluster, require_server_for_nodes, sharing
from cluster.session.interrupts import InterruptGuard
from cluster.session.session import Session
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from cluster.storage.run_folder import locked_settings
from cluster.tracking import Tracker
from cluster.tracking.tracker import check_tracking_uri, mlflow_imported_meanwhile


@dataclass(frozen=True)
class Place:
    """Home, MLflow and Ray cluster; a resumed run may change all but the home."""

    home: Home
    tracking_uri: str
    address: str | None = None  # of a Ray cluster to join; None: start a local one

    @contextlib.contextmanager
    def entered(self) -> Iterator["Driver"]:
        """Within the block this process is a driver of the cluster; nothing is written.

        Raises InvalidInput for an invalid or unreachable MLflow or cluster, and for SQLite on
        several nodes.
        """
        check_tracking_uri(self.tracking_uri)
        with (
            Terminal() as terminal,
            mlflow_imported_meanwhile(),
            ray_cluster(self.address),
            InterruptGuard(terminal) as guard,  # after Ray, which installs its own SIGTERM handler
        ):
            require_server_for_nodes(self.tracking_uri)
            if ray.available_resources().get("CPU", 0) < 1:
                terminal.line("all cores of the cluster are taken: waiting until one is free")
            with sharing():
                yield Driver(self, terminal, guard)


@dataclass(frozen=True)
class Driver:
    """This process as a driver of the cluster."""

    place: Place
    terminal: Terminal
    guard: InterruptGuard

    @contextlib.contextmanager
    def session(self, folder: Path, task_id: str, settings: dict[str, Any]) -> Iterator[Session]:
        """Within the block this process holds the lock of the run in `folder`.

        Raises InvalidInput if the home cannot be written, if another process holds the lock,
        or if the run was begun with other settings.
        """
        home = self.place.home
        home.prepare()
        tracker = Tracker(self.place.tracking_uri, task_id, home.artifacts)
        with locked_settings(folder, settings) as begun:
            yield Session(home, folder, begun, tracker, self.terminal, self.guard)
