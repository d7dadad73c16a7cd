"""Where a command runs this time: its home, its MLflow, its Ray cluster."""

import contextlib
import signal
from collections.abc import Iterator
from dataclasses import dataclass

import ray

from cluster.ray.connection import ray_cluster, require_server_for_nodes, sharing
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from cluster.tracking import Tracker
from cluster.tracking.tracker import check_tracking_uri, mlflow_imported_meanwhile


@dataclass(frozen=True)
class Place:
    """All of it may differ when a run is continued, but the home."""

    home: Home
    tracking_uri: str
    address: str | None = None  # of a Ray cluster to join; None: one of the process's own

    @contextlib.contextmanager
    def entered(self) -> Iterator[Terminal]:
        """Within the block this process is a driver of the cluster; nothing is written.

        Raises InvalidInput for a tracking URI or a cluster that will not do.
        """
        check_tracking_uri(self.tracking_uri)
        with (
            Terminal() as terminal,
            mlflow_imported_meanwhile(),
            ray_cluster(self.address),
            _termination_is_an_interrupt(),  # after Ray, which takes SIGTERM for itself
        ):
            require_server_for_nodes(self.tracking_uri)
            if ray.available_resources().get("CPU", 0) < 1:
                terminal.line("all cores of the cluster are taken: waiting until one is free")
            with sharing():
                yield terminal

    def tracker(self, task_id: str) -> Tracker:
        """Of the task's experiment. Raises InvalidInput if the home cannot be written."""
        self.home.prepare()
        return Tracker(self.tracking_uri, task_id, self.home.artifacts)


@contextlib.contextmanager
def _termination_is_an_interrupt() -> Iterator[None]:
    """Within the block SIGTERM stops what is run as orderly as Ctrl-C does."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
