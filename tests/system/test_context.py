"""Connecting to a cluster, leaving it, and sharing it with other runs."""

import os
import signal
import time
from pathlib import Path

import pytest
import ray

from bilevel import InvalidInput
from cluster.ray.connection import Capacity, sharing
from cluster.ray.pool import EvaluationPool
from cluster.session.context import RunContext
from cluster.storage.home import Home

pytestmark = pytest.mark.timeout(120)


def test_termination_stops_it_as_ctrl_c_does(tmp_path: Path, address: str) -> None:
    home = Home(tmp_path / "home")

    def terminated() -> None:
        with RunContext(home, home.database_uri, address).connected():
            with sharing():  # a second run
                capacity = Capacity.of_cluster()
                assert capacity.runs == 2
                assert capacity.fair_share(1) == max(capacity.cores // 2, 1)
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(10)

    with pytest.raises(KeyboardInterrupt):
        terminated()
    assert not ray.is_initialized()
    assert not home.folder.exists()  # nothing was run


def test_more_trials_than_cores_wait_for_cores_that_join(
    tmp_path: Path, address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a cluster that a command joins, which an autoscaler may enlarge; one trial must fit."""
    home = Home(tmp_path / "home")
    context = RunContext(home, home.database_uri, address)
    with context.connected(1, 9):
        assert Capacity.of_cluster().cores == 2
    assert "9 cores are asked for, the cluster has 2: trials wait" in capsys.readouterr().out
    with pytest.raises(InvalidInput, match="need 9 cores"), context.connected(9):
        pass


def test_runs_share_the_cores_equally(joined_ray: None) -> None:
    def fair_share() -> int:
        return Capacity.of_cluster().fair_share(1)

    cores = Capacity.of_cluster().cores
    with sharing():
        assert fair_share() == cores
        with sharing():
            assert fair_share() == max(cores // 2, 1)
            with EvaluationPool.on_cluster(None) as pool:
                assert pool.size == max(cores // 2, 1)
        deadline = time.monotonic() + 90
        while fair_share() != cores:
            assert time.monotonic() < deadline
            time.sleep(0.1)
