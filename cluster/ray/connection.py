"""Start a local Ray cluster, or join a running one."""

import logging
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import ray
from loky import cpu_count

from bilevel.errors import InvalidInput, first_line
from cluster.ray.agent_files import runtime_env

#: Ray gives a local node 30 seconds to start, which a loaded machine may exceed.
_ATTEMPTS = 2
#: Ray sets this variable when it starts a cluster. A child process that inherited it would send a
#: token that the cluster of its parent does not expect.
_AUTHENTICATION = "RAY_AUTH_MODE"


@contextmanager
def environment_kept(*names: str) -> Iterator[None]:
    """Restore these environment variables after the block."""
    before = {name: os.environ[name] for name in names if name in os.environ}
    try:
        yield
    finally:
        for name in names:
            os.environ.pop(name, None)
        os.environ.update(before)


@contextmanager
def ray_cluster(address: str | None) -> Iterator[None]:
    """Connect this process to a Ray cluster for the block. Raises InvalidInput.

    `address` is a running cluster that has a node on this machine (`host:port` or `auto`). None
    starts a local cluster, which ends with the block.
    """
    if address == "auto":
        address = os.environ.get("RAY_ADDRESS", address)
    if address not in (None, "auto"):
        _require_reachable(address)
    with environment_kept(_AUTHENTICATION):
        _connect(address)
        try:
            yield
        finally:
            ray.shutdown()


def _connect(address: str | None, attempts: int = _ATTEMPTS) -> None:
    local = address is None
    # `timeout`, batch systems and closed terminals signal the whole process group. The processes of
    # a local cluster inherit the blocked signals, so that this process can stop the cluster in
    # order. The end takes four seconds longer, because Ray must send SIGKILL after SIGTERM.
    blocked = {signal.SIGTERM, signal.SIGHUP} if local else set()
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
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
        if local and attempts > 1:
            return _connect(address, attempts - 1)
        failed = "cannot start Ray here" if local else f"no Ray cluster at {address!r}"
        raise InvalidInput(f"{failed}: {first_line(error)}") from None
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)


def _require_reachable(address: str) -> None:
    """Raise InvalidInput at once for an address for which Ray would wait minutes."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or "/" in host:  # ray:// connects clients, which are no nodes
        raise InvalidInput(
            f"Ray address {address!r} is not valid: allowed are host:port and auto, on a node of "
            "the cluster (docs/cluster.md)"
        )
    try:
        socket.create_connection((host, int(port)), timeout=5).close()
    except (OSError, OverflowError) as error:
        raise InvalidInput(f"no Ray cluster at {address!r}: {error}") from None


def cluster_cores() -> int:
    """Return the current number of cores of the connected cluster, at least 1."""
    return max(int(ray.cluster_resources().get("CPU", 0)), 1)


def require_cores(cores: int, workers: int, trials: int = 1) -> None:
    """Raise InvalidInput if a cluster of `cores` cores has fewer than `trials` trials need."""
    if workers * trials > cores:
        raise InvalidInput(
            f"{trials} x {workers} workers need {trials * workers} cores: the cluster has {cores}"
        )


def require_server_for_nodes(tracking_uri: str) -> None:
    """Raise InvalidInput for a SQLite database if the cluster has several nodes."""
    nodes = sum(bool(node["Alive"]) for node in ray.nodes())
    if nodes > 1 and tracking_uri.startswith("sqlite"):
        raise InvalidInput(
            f"a cluster of {nodes} nodes cannot be tracked in {tracking_uri!r}: give an MLflow "
            "server with --tracking-uri http://host:port (docs/cluster.md)"
        )
