"""Start a local Ray cluster, or join a running one."""

import logging
import os
import socket
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Self

import ray
from loky import cpu_count
from ray.util.placement_group import (
    placement_group,
    placement_group_table,
    remove_placement_group,
)

from bilevel.errors import InvalidInput, first_line
from cluster.ray.agent_files import runtime_env
from cluster.ray.environment import environment_kept

_TIMEOUT = 5.0  # seconds until an address counts as unreachable
#: Ray gives a node 30 seconds to start, which a loaded machine may exceed.
_ATTEMPTS = 2
#: Prefix of the placement groups that mark runs.
_MARK = "bilevel-run-"
#: Ray sets this variable when it starts a cluster. A child process that inherited it would send a
#: token that the cluster of its parent does not expect.
_AUTHENTICATION = "RAY_AUTH_MODE"


@contextmanager
def ray_cluster(address: str | None) -> Iterator[None]:
    """Connect this process to a Ray cluster for the block.

    `address` is a running cluster that has a node on this machine (`host:port` or `auto`). None
    starts a local cluster, which ends with the block. Raises InvalidInput if the cluster cannot be
    started or reached.
    """
    if address == "auto":
        address = os.environ.get("RAY_ADDRESS", address)
    if address not in (None, "auto"):
        _require_reachable(address)
    with environment_kept(_AUTHENTICATION):
        _connect(address, 1 if address else _ATTEMPTS)
        try:
            yield
        finally:
            ray.shutdown()


def _connect(address: str | None, attempts: int) -> None:
    local = address is None
    try:
        ray.init(
            address=address or "local",
            num_cpus=cpu_count() if local else None,
            include_dashboard=False if local else None,
            log_to_driver=False,
            logging_level=logging.ERROR,
            runtime_env=runtime_env(local),
        )
    except Exception as error:  # Ray raises bare exceptions if a node does not start in time
        ray.shutdown()
        if attempts > 1:
            return _connect(address, attempts - 1)
        failed = "cannot start Ray here" if local else f"no Ray cluster at {address!r}"
        raise InvalidInput(f"{failed}: {first_line(error)}") from None


def _require_reachable(address: str) -> None:
    """Raise InvalidInput at once for an address for which Ray would wait minutes."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or "/" in host:  # ray:// connects clients, which are no nodes
        raise InvalidInput(
            f"Ray address {address!r} is not valid: allowed are host:port and auto, on a node of "
            "the cluster; from elsewhere, submit the command as a job (docs/cluster.md)"
        )
    try:
        socket.create_connection((host, int(port)), _TIMEOUT).close()
    except (OSError, OverflowError) as error:
        raise InvalidInput(f"no Ray cluster at {address!r}: {error}") from None


@dataclass(frozen=True)
class Capacity:
    """Cores of a cluster, and the number of runs that share them."""

    cores: int
    runs: int = 1

    @classmethod
    def of_cluster(cls) -> Self:
        """Return the current capacity of the connected cluster."""
        groups = placement_group_table().values()
        names = [group["name"] for group in groups if group["state"] != "REMOVED"]
        runs = sum(name.startswith(_MARK) for name in names)
        return cls(int(ray.cluster_resources().get("CPU", 0)), max(runs, 1))

    @classmethod
    def of_own(cls) -> Self:
        """Return the capacity of a local cluster: all cores that this process may use."""
        return cls(cpu_count())

    def fair_share(self, workers_per_trial: int) -> int:
        """Return how many trials of `workers_per_trial` cores fit into one run's share, at least
        1."""
        return max(self.cores // workers_per_trial // self.runs, 1)

    def require(self, workers_per_trial: int, concurrent_trials: int = 1) -> None:
        """Raise InvalidInput if the cluster has fewer cores than these trials need."""
        needed = workers_per_trial * concurrent_trials
        if needed > self.cores:
            trials = f"{workers_per_trial} workers"
            if concurrent_trials > 1:
                trials = f"{concurrent_trials} concurrent trials of {trials} each"
            raise InvalidInput(f"{trials} need {needed} cores: the cluster has {self.cores}")


@contextmanager
def scaled_to(cores: int, address: str | None) -> Iterator[None]:
    """Request `cores` cores from the autoscaler of the cluster at `address` during the block.

    The request has no effect on a cluster without autoscaler. Ray keeps only the latest request of
    all drivers.
    """
    if address is None:  # a local cluster has no autoscaler
        yield
        return
    from ray.autoscaler.sdk import request_resources  # a slow import that actors do not need

    request_resources(num_cpus=cores)
    try:
        yield
    finally:
        with suppress(Exception):  # the cluster may have ended
            request_resources(num_cpus=0)


@contextmanager
def sharing() -> Iterator[None]:
    """Let other runs on the cluster leave this run its share of the cores during the block.

    A tiny placement group marks the run. Ray removes it when the driver ends for any reason.
    """
    mark = placement_group([{"memory": 1}], name=f"{_MARK}{uuid.uuid4().hex}")
    try:
        yield
    finally:
        remove_placement_group(mark)


def require_server_for_nodes(tracking_uri: str) -> None:
    """Raise InvalidInput for a SQLite database if the cluster has several nodes."""
    nodes = sum(bool(node["Alive"]) for node in ray.nodes())
    if nodes > 1 and tracking_uri.startswith("sqlite"):
        raise InvalidInput(
            f"cannot track a cluster of {nodes} nodes in {tracking_uri!r}: SQLite does not support "
            "shared storage; give an MLflow server with --tracking-uri http://host:port "
            "(docs/cluster.md)"
        )
