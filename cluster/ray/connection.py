"""Start a local Ray cluster, or join a running one."""

import contextlib
import logging
import socket
import subprocess
import sys
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import ray
import ray.exceptions
from loky import cpu_count
from ray._private.services import get_ray_address_from_environment
from ray.util.placement_group import (
    placement_group,
    placement_group_table,
    remove_placement_group,
)

from bilevel.errors import InvalidInput, first_line
from cluster.ray.agent_files import runtime_env
from cluster.ray.environment import environment_kept

_CONNECT_TIMEOUT = 5.0  # seconds until an address counts as unreachable
#: Ray gives a node half a minute to start, which is not always enough on a loaded machine.
_STARTS = 2
#: Prefix of the names of placement groups that mark a run.
_MARK = "bilevel-run-"
#: Ray sets this variable when it starts a cluster. If it stayed set, a child process would demand
#: a token that its parent, which imported Ray earlier, does not send, and could not connect.
_AUTHENTICATION = "RAY_AUTH_MODE"


@contextlib.contextmanager
def ray_cluster(address: str | None) -> Iterator[None]:
    """Within the block, this process is a driver of a Ray cluster.

    `address` joins a running cluster (`host:port` or `auto`), of which this machine must be a node;
    otherwise a local one is started and stopped again. Raises InvalidInput if the
    address cannot be reached.
    """
    own = is_own(address)
    if not own:
        _require_reachable(str(address))
    with environment_kept(_AUTHENTICATION):
        _connect(address or "local", own, _STARTS if own else 1)
        try:
            yield
        finally:
            ray.shutdown()


@contextlib.contextmanager
def _in_groups_of_their_own() -> Iterator[None]:
    """Within the block, processes that are started leave this one's process group. A signal to the
    group, as `timeout` and batch systems send it, then reaches this process alone, which stops its
    cluster in order. Linux alone ends Ray's processes with this one, however that ends; elsewhere
    Ray watches the group for them, and it stays as it is."""
    if sys.platform != "linux":
        yield
        return
    begin = subprocess.Popen.__init__

    def begin_a_group(self: Any, *args: Any, **options: Any) -> None:
        begin(self, *args, **{"process_group": 0, **options})

    subprocess.Popen.__init__ = begin_a_group  # type: ignore[method-assign]
    try:
        yield
    finally:
        subprocess.Popen.__init__ = begin  # type: ignore[method-assign]


def _connect(address: str, own: bool, attempts: int) -> None:
    """Start or join the cluster. Raises InvalidInput if all attempts fail."""
    try:
        with _in_groups_of_their_own():
            ray.init(
                address=address,
                num_cpus=cpu_count() if own else None,
                include_dashboard=False if own else None,
                log_to_driver=False,
                logging_level=logging.ERROR,
                runtime_env=runtime_env(own),
            )
    except Exception as error:  # bare where a node does not start in time
        ray.shutdown()
        if attempts > 1:
            return _connect(address, own, attempts - 1)
        place = "cannot start Ray here" if own else f"no Ray cluster at {address!r}"
        raise InvalidInput(f"{place}: {first_line(error)}") from None


def is_own(address: str | None) -> bool:
    """Whether this address means a cluster of a command's own, which it starts and stops."""
    return address in (None, "local")


def _require_reachable(address: str) -> None:
    told = repr(address)
    if address == "auto":  # Ray would try for minutes to reach one that was killed
        try:
            address = get_ray_address_from_environment(address, None)
        except ConnectionError as error:
            raise InvalidInput(f"no Ray cluster at 'auto': {first_line(error)}") from None
        told += f", which is {address!r}, the one that was started last"
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or "/" in host:  # ray:// is of a client, which is no node
        raise InvalidInput(
            f"Ray address {address!r} is not valid: allowed are host:port and auto, on a node of "
            "the cluster; from elsewhere, submit the command as a job (docs/cluster.md)"
        )
    try:
        socket.create_connection((host, int(port)), _CONNECT_TIMEOUT).close()
    except (OSError, OverflowError) as error:
        raise InvalidInput(f"no Ray cluster at {told}: {error}") from None


@dataclass(frozen=True)
class Capacity:
    """Capacity of a cluster for a run."""

    cores: int  # of all nodes together
    runs: int = 1  # that share them

    @classmethod
    def of_cluster(cls) -> Self:
        """Capacity of the connected cluster, now."""
        groups = placement_group_table().values()
        names = [group["name"] for group in groups if group["state"] != "REMOVED"]
        runs = sum(1 for name in names if name.startswith(_MARK))
        return cls(int(ray.cluster_resources().get("CPU", 0)), max(runs, 1))

    @classmethod
    def of_own(cls) -> Self:
        """Capacity of a local cluster: all cores that this process may use."""
        return cls(cpu_count())

    def fair_share(self, workers_per_trial: int) -> int:
        """Number of trials, of `workers_per_trial` cores each, that a run may have at a time, at
        least one: the cores are shared equally among the runs."""
        return max(self.cores // workers_per_trial // self.runs, 1)

    def require(self, workers_per_trial: int, concurrent_trials: int = 1) -> None:
        """Raise InvalidInput if the cluster cannot place that many one-core workers."""
        wanted = workers_per_trial * concurrent_trials
        if wanted > self.cores:
            told = f"{workers_per_trial} workers"
            if concurrent_trials > 1:
                told = f"{concurrent_trials} trials at a time with {workers_per_trial} workers each"
            raise InvalidInput(f"{told} need {wanted} cores: the cluster has {self.cores}")


@contextlib.contextmanager
def scaled_to(cores: int, address: str | None) -> Iterator[None]:
    """Ask the autoscaler of the connected cluster, if it has one, for so many cores during the
    block. Ray keeps the request of the driver that asked last. `address` is what the cluster was
    joined by: one of a command's own has no autoscaler.
    """
    if is_own(address):  # to ask takes a second
        yield
        return
    _request(cores)
    try:
        yield
    finally:
        _request(0)


def _request(cores: int) -> None:
    """In a task, which may be given up where the cluster does not answer."""

    def ask() -> None:
        from ray.autoscaler.sdk import request_resources  # slow, and no actor needs it

        request_resources(num_cpus=cores)

    with contextlib.suppress(ray.exceptions.RayError):  # the cluster may be gone
        ray.get(ray.remote(num_cpus=0)(ask).remote(), timeout=60)


@contextlib.contextmanager
def sharing() -> Iterator[None]:
    """Within the block, other runs on the cluster leave this run its share of the cores.

    A tiny placement group marks the run; Ray removes the mark when the driver ends in any way.
    """
    mark = placement_group([{"memory": 1}], name=f"{_MARK}{uuid.uuid4().hex}")
    try:
        yield
    finally:
        remove_placement_group(mark)


def require_server_for_nodes(tracking_uri: str) -> None:
    """Raise InvalidInput for a SQLite database when the cluster has several nodes."""
    nodes = sum(bool(node["Alive"]) for node in ray.nodes())
    if nodes > 1 and tracking_uri.startswith("sqlite"):
        raise InvalidInput(
            f"a cluster of {nodes} nodes cannot be tracked in {tracking_uri!r}: SQLite's locks do "
            "not hold on storage that nodes share, and another node could not read it; give an "
            "MLflow server with --tracking-uri http://host:port (docs/cluster.md)"
        )
