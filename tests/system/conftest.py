"""System tests with real Ray, MLflow and processes; each takes seconds to a minute."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mlflow
import pytest
import ray
from ray.cluster_utils import Cluster

from bilevel.nes import NESState
from cluster.ray.connection import ray_cluster
from cluster.ray.environment import environment_kept
from cluster.tracking.connection import connected
from tests.commands import BILEVEL
from tests.faults.outcome import TIMES
from tests.faults.stage import WITHOUT_VIEWS


@pytest.fixture(scope="session", autouse=True)
def ray_folder() -> Iterator[None]:
    """Give this process its own folder for Ray, in which Ray records the latest cluster. The path
    is short because paths of sockets are limited."""
    short = tempfile.TemporaryDirectory(prefix="ray-", dir="/tmp", ignore_cleanup_errors=True)
    with short as folder, environment_kept("RAY_TMPDIR"):
        os.environ["RAY_TMPDIR"] = folder
        yield


@pytest.fixture(scope="session")
def address() -> Iterator[str]:
    """Address of a Ray cluster of two cores that all tests share. Starting a cluster for each
    command would keep both cores busy for seconds."""
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, **WITHOUT_VIEWS})
    yield cluster.address
    cluster.shutdown()


@pytest.fixture(scope="module")
def joined_ray(address: str) -> Iterator[None]:
    """Connect this process to the shared cluster."""
    before = _of_ray()
    with ray_cluster(address):
        yield
    assert not ray.is_initialized()
    assert _of_ray() == before  # child processes must not inherit Ray's variables


@pytest.fixture(scope="session")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """MLflow's database without runs. Copying it saves the seconds of creating one."""
    path = tmp_path_factory.mktemp("database") / "mlflow.db"
    with connected(f"sqlite:///{path}"):
        return path


@pytest.fixture
def tmp_home(tmp_path: Path, database: Path) -> Path:
    """A home without runs."""
    shutil.copy(database, tmp_path)
    return tmp_path


def _of_ray() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name.startswith("RAY_")}


def client(home: Path) -> mlflow.MlflowClient:
    uri = f"sqlite:///{home}/mlflow.db"
    return mlflow.MlflowClient(uri, registry_uri=uri)


def untimed(state: NESState) -> list[dict[str, Any]]:
    """Return a run's records without measured times."""
    return [
        {name: value for name, value in asdict(record).items() if name not in TIMES}
        for record in state.records
    ]


def run_until(line: str, *args: str | Path) -> subprocess.Popen[str]:
    """Start the console script and return it once it has printed a line that contains `line`.

    It runs in its own session, so that tests can signal all its processes like a terminal does.
    """
    process = subprocess.Popen(
        [BILEVEL, *map(str, args)], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    for printed in process.stdout:
        if line in printed:
            break
    return process
