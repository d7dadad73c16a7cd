"""Connecting to a cluster, leaving it, and working on it with other runs."""

import os
import signal
import time
from pathlib import Path

import pytest
import ray

from cluster.ray.connection import cluster_cores
from cluster.session.context import RunContext
from cluster.storage.home import Home
from tests.commands import run_bilevel, start_bilevel
from tests.mlflow_shown import disagreements

pytestmark = pytest.mark.timeout(120)


def test_sigterm_leaves_the_cluster_like_ctrl_c(tmp_path: Path, address: str) -> None:
    home = Home(tmp_path / "home")

    def terminated() -> None:
        with RunContext(home, home.database_uri, address).connected():
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(10)

    with pytest.raises(KeyboardInterrupt):
        terminated()
    assert not ray.is_initialized()
    assert not home.folder.exists()


def test_trials_wait_for_cores_of_a_joined_cluster(
    tmp_path: Path, address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its autoscaler may add nodes."""
    home = Home(tmp_path / "home")
    context = RunContext(home, home.database_uri, address)
    with context.connected(3, 3):
        assert cluster_cores() == 2
    assert "9 cores requested, 2 of the cluster's cores are free" in capsys.readouterr().out


def test_two_commands_at_once_share_cluster_and_home(
    tmp_home: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They join the cluster that RAY_ADDRESS names."""
    monkeypatch.setenv("RAY_ADDRESS", address)
    small = (
        *("nes", "CartPole-v0", "--population", "2", "--generations", "1", "--workers", "1"),
        *("--set", "nes.start_candidates=2", "--set", "ddqn.max_episodes=13"),
        *("--set", "ddqn.init_episodes=5", "--set", "nes.centre_agents=2", "--home", str(tmp_home)),
    )
    names = ("one", "two")
    running = [start_bilevel([*small, "--name", name], tmp_home / f"{name}.log") for name in names]
    for process in running:
        process.join(100)
    outputs = [(tmp_home / f"{name}.log").read_text() for name in names]
    assert [process.exitcode for process in running] == [0, 0], outputs
    assert run_bilevel("runs", "--home", tmp_home).stdout.count("finished") == 2
    home = Home(tmp_home)
    for name in names:
        assert disagreements(home.run_folder("CartPole-v0", name), home.database_uri) == []
