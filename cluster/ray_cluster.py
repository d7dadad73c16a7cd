"""Start a local Ray cluster, or join a running one."""

import contextlib
import logging
import os
import socket
from collections.abc import Iterator

import ray

from bilevel.errors import InvalidInput
from cluster.agent_files import runtime_env

_CONNECT_TIMEOUT = 5.0  # seconds until an address counts as unreachable


@contextlib.contextmanager
def ray_cluster(address: str | None) -> Iterator[None]:
    """Within the block, this process is a driver of a Ray cluster.

    `address` joins a running cluster (`host:port`, `ray://host:port` or `auto`),
    otherwise a local one is started and stopped again. `RAY_ADDRESS` counts if no
    address is given. Raises InvalidInput if the address cannot be reached.
    """
    address = address or os.environ.get("RAY_ADDRESS") or None
    if address is not None and address not in ("auto", "local"):
        _require_reachable(address)
    try:
        ray.init(
            address=address or "local",
            include_dashboard=False if address in (None, "local") else None,
            log_to_driver=False,
            logging_level=logging.ERROR,
            runtime_env=runtime_env(),
        )
    except (ConnectionError, ValueError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[0]
        raise InvalidInput(f"no Ray cluster at {address!r}: {reason}") from None
    try:
        yield
    finally:
        ray.shutdown()


def _require_reachable(address: str) -> None:
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        raise InvalidInput(
            f"Ray address {address!r} is not valid: allowed are host:port, ray://host:port, auto"
        )
    try:
        socket.create_connection((host, int(port)), _CONNECT_TIMEOUT).close()
    except (OSError, OverflowError) as error:
        raise InvalidInput(f"no Ray cluster at {address!r}: {error}") from None


def cluster_cores() -> int:
    """Cores of the cluster, all nodes together."""
    return int(ray.cluster_resources().get("CPU", 0))


def require_capacity(workers_per_trial: int, concurrent_trials: int = 1) -> None:
    """Raise InvalidInput if the cluster cannot place that many one-core workers."""
    cores = cluster_cores()
    wanted = workers_per_trial * concurrent_trials
    if wanted > cores:
        raise InvalidInput(
            f"{concurrent_trials} trial(s) of {workers_per_trial} worker(s) need {wanted} cores: "
            f"the cluster has {cores}"
        )
