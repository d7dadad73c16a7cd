"""`bilevel ui`: a real MLflow server on the runs of a home."""

import os
import signal
import socket
import subprocess
import time
import urllib.request
from pathlib import Path

from cluster.storage.home import Home
from cluster.tracking import Tracker
from tests.commands import BILEVEL, free_port, listening, run_bilevel


def answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(url, timeout=5) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def test_ui_prints_its_pages_and_serves_until_ctrl_c(tmp_home: Path) -> None:
    home, port = Home(tmp_home), free_port()
    Tracker(home.database_uri, "CartPole-v0", home)
    process = subprocess.Popen(
        [BILEVEL, "ui", "--home", tmp_home, "--port", str(port)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    server = f"http://127.0.0.1:{port}/#/experiments"
    assert process.stdout.readline().startswith(f"MLflow UI: {server}")
    assert process.stdout.readline().startswith(f"CartPole-v0: {server}/1/runs")
    deadline = time.monotonic() + 90
    while not answers(f"http://127.0.0.1:{port}/health"):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    rest, _ = process.communicate(timeout=60)
    assert [line for line in rest.splitlines() if not line.startswith("[MLflow]")] == []
    assert process.returncode == 0
    assert not listening("127.0.0.1", port)


def test_port_in_use(tmp_home: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        result = run_bilevel("ui", "--home", tmp_home, "--port", str(port))
    assert result.returncode == 2
    assert f"cannot serve on 127.0.0.1:{port}" in result.stderr
