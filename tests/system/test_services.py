"""`bilevel up`, `status`, `down`: real Ray head, real MLflow server, studies that join."""

import os
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from cluster.services.background import services
from cluster.services.ports import free_port
from cluster.storage.home import Home
from cluster.tracking import Tracker
from tests.commands import BILEVEL, listening, run_bilevel
from tests.mlflow_shown import disagreements

pytestmark = pytest.mark.timeout(290)


@dataclass(frozen=True)
class Up:
    home: Path
    ray_port: int
    dashboard: int
    mlflow: int


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Up]:
    it = Up(tmp_path_factory.mktemp("home"), free_port(), free_port(), free_port())
    ports = ("--ray-port", it.ray_port, "--dashboard-port", it.dashboard)
    result = run_bilevel("up", "--home", it.home, *map(str, (*ports, "--mlflow-port", it.mlflow)))
    try:
        assert result.returncode == 0, result.stderr
        yield it
    finally:
        run_bilevel("down", "--home", it.home)


def test_status_tells_and_both_are_healthy(up: Up) -> None:
    result = run_bilevel("status", "--home", up.home)
    assert result.returncode == 0
    assert [line.split()[:2] for line in result.stdout.splitlines()] == [
        ["ray", "up"],
        ["mlflow", "up"],
    ]
    for address in (f"{up.dashboard}/api/gcs_healthz", f"{up.mlflow}/health"):
        with urllib.request.urlopen(f"http://127.0.0.1:{address}") as answer:
            assert answer.status == 200


def test_their_pages_are_bound_to_this_machine_alone(up: Up) -> None:
    ours = {up.dashboard, up.mlflow}
    bound = {
        connection.laddr.ip
        for service in services(Home(up.home))
        for process in psutil.Process(service.pid).children(recursive=True)
        for connection in process.net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN and connection.laddr.port in ours
    }
    assert bound == {"127.0.0.1"}
    assert listening("127.0.0.1", up.mlflow)


def test_ray_asks_for_the_homes_token(up: Up) -> None:
    token = up.home / "ray.token"
    assert token.stat().st_mode & 0o777 == 0o600
    with pytest.raises(urllib.error.HTTPError, match="401"):
        urllib.request.urlopen(f"http://127.0.0.1:{up.dashboard}/api/version")


def test_up_again_starts_nothing(up: Up) -> None:
    before = services(Home(up.home))
    result = run_bilevel("up", "--home", up.home)
    assert result.returncode == 0
    assert "ray is up already" in result.stdout
    assert services(Home(up.home)) == before


def test_two_studies_at_once_and_a_submitted_job_share_the_cluster(up: Up) -> None:
    """Studies in the services' home join them without an address, or with `auto`."""
    study = (
        *("bohb", "CartPole-v0", "--profile", "smoke", "--brackets", "1", "--home", str(up.home)),
        *("--method", "random", "--vary-hp", "no", "--set", "nes.centre_agents=2"),
        *("--set", "ddqn.hidden_size=16", "--set", "ddqn.batch_size=16", "--solved-reward", "190"),
    )
    environment = {k: v for k, v in os.environ.items() if k != "RAY_ADDRESS"}
    running = [
        subprocess.Popen(
            [BILEVEL, *study, "--study", name, "--seed", str(seed), *address],
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for seed, (name, *address) in enumerate((("one",), ("two", "--address", "auto")))
    ]
    outputs = [process.communicate(timeout=240)[0] for process in running]
    assert [process.returncode for process in running] == [0, 0], outputs
    for name, output in zip(("one", "two"), outputs, strict=True):
        hint = f"nes CartPole-v0 --recipe {name} --solved-reward 190 --home {up.home}`"
        assert hint in " ".join(output.split())
    listed = run_bilevel("runs", "--home", up.home).stdout
    assert listed.count("finished") == 2
    page = f"CartPole-v0: http://127.0.0.1:{up.mlflow}/#/experiments/"
    assert page in run_bilevel("status", "--home", up.home).stdout
    assert listed.count("1/1 results") == 2
    ray = str(Path(BILEVEL).with_name("ray"))
    command = [ray, "job", "submit", "--address", f"http://127.0.0.1:{up.dashboard}", "--", BILEVEL]
    command += [
        *("nes", "CartPole-v0", "--population", "2", "--generations", "1", "--home", str(up.home)),
        *("--set", "nes.start_candidates=2", "--set", "ddqn.max_episodes=13"),
        *("--set", "se.step_limit=20", "--set", "nes.centre_agents=2"),
        *("--name", "submitted", "--workers", "1"),
    ]
    (head,) = (service for service in services(Home(up.home)) if service.name == "ray")
    submitted = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=200,
        env={**environment, **head.environment},
        check=False,
    )
    assert submitted.returncode == 0, submitted.stdout + submitted.stderr
    for name in ("one", "two", "submitted"):
        folder = Home(up.home).run_folder("CartPole-v0", name)
        assert disagreements(folder, f"http://127.0.0.1:{up.mlflow}") == []


def test_down_stops_all_it_started_and_nothing_else(up: Up) -> None:
    stranger = subprocess.Popen(["sleep", "600"])
    family = [
        process
        for service in services(Home(up.home))
        for process in [
            psutil.Process(service.pid),
            *psutil.Process(service.pid).children(recursive=True),
        ]
    ]
    assert len(family) > 4
    result = run_bilevel("down", "--home", up.home)
    assert result.returncode == 0
    assert result.stdout.splitlines() == ["mlflow is down", "ray is down"]
    # Of those that it does not start itself it cannot collect the exit codes.
    gone = (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
    assert not [one for one in family if one.is_running() and one.status() not in gone]
    assert stranger.poll() is None
    stranger.kill()
    stranger.wait()
    assert run_bilevel("status", "--home", up.home).returncode == 1
    assert "nothing is up" in run_bilevel("down", "--home", up.home).stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_the_ui_ends_without_a_traceback(tmp_path: Path, number: signal.Signals) -> None:
    home, port = Home(tmp_path), free_port()
    home.prepare()
    Tracker(home.database_uri, "CartPole-v0", home.artifacts)
    process = subprocess.Popen(
        [BILEVEL, "ui", "--home", home.folder, "--port", str(port)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    server = f"http://127.0.0.1:{port}/#/experiments"
    page = f"{server}/1/runs?viewStateShareKey=bilevel&workflowType="
    told = process.stdout.readline()
    assert told == f"MLflow UI: {server}?workflowType=machine_learning\n"
    assert process.stdout.readline() == f"CartPole-v0: {page}machine_learning\n"
    assert process.stdout.readline() == "Ctrl-C ends the MLflow UI\n"
    deadline = time.monotonic() + 90
    while not listening("127.0.0.1", port):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    os.killpg(process.pid, number)  # to everyone, as a terminal does
    rest, _ = process.communicate(timeout=60)
    # MLflow itself tells of its security.
    assert [line for line in rest.splitlines() if not line.startswith("[MLflow]")] == []
    assert process.returncode == 0
    assert not listening("127.0.0.1", port)


@pytest.mark.parametrize("which", ["--ray-port", "--dashboard-port", "--mlflow-port"])
def test_a_taken_port_is_told_before_anything_is_started(tmp_path: Path, which: str) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = run_bilevel("up", "--home", tmp_path, which, str(port))
    assert result.returncode == 2
    assert f"cannot serve on 127.0.0.1:{port}" in result.stderr
    assert result.stdout == ""
    assert services(Home(tmp_path)) == []
