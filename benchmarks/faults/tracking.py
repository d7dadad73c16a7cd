"""Faults of MLflow: its server killed, its database locked."""

import os
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import psutil

from benchmarks.faults.outcome import Outcome
from benchmarks.faults.row import Row
from benchmarks.faults.stage import ONE_BY_ONE, Stage
from cluster.home import Home
from cluster.mlflow_server import mlflow_server
from cluster.ports import free_port, listening


class Server:
    """An MLflow server on a home of its own; a context manager that ends it.

    With a `backend` it is set up as docs/cluster.md has it for several nodes: on that
    database, and with artifacts that go through the server.
    """

    def __init__(self, folder: Path, backend: str | None = None) -> None:
        self._home = Home(folder)
        self._backend = backend
        self._home.prepare()
        self._port = free_port()
        self._process: psutil.Popen | None = None

    @property
    def uri(self) -> str:
        """Where it answers."""
        return f"http://127.0.0.1:{self._port}"

    def start(self) -> None:
        """Returns once it answers."""
        command, environment = mlflow_server(self._home, "127.0.0.1", self._port)
        if self._backend is not None:
            command = [*command[: command.index("--backend-store-uri")]]
            command += ["--backend-store-uri", self._backend]
            command += ["--artifacts-destination", str(self._home.artifacts)]
        with (self._home.folder / "server.log").open("a") as log:
            self._process = psutil.Popen(
                [str(Path(sys.executable).with_name(command[0])), *command[1:]],
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **environment},
                start_new_session=True,
            )
        deadline = time.monotonic() + 90
        while not listening("127.0.0.1", self._port):
            if time.monotonic() > deadline:
                raise TimeoutError("the MLflow server does not come up")
            time.sleep(0.1)

    def kill(self) -> None:
        """At once (SIGKILL), in the middle of whatever it does."""
        if self._process is not None:
            family = [self._process, *self._process.children(recursive=True)]
            for process in family:
                process.kill()
            psutil.wait_procs(family, 30)
            self._process = None

    def __enter__(self) -> "Server":
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.kill()


def server_killed(stage: Stage, whole: Outcome, times: int) -> Row:
    """SIGKILL the server during the study, and start it some seconds later."""
    with Server(stage.folder / "server-killed") as server:
        study = stage.study("server", *ONE_BY_ONE, tracking_uri=server.uri)
        killed = [0]
        pause = [time.monotonic() + 6.0]

        def kill() -> None:
            if killed[0] < times and time.monotonic() > pause[0]:
                server.kill()
                time.sleep(stage.chance.uniform(1.0, 4.0))
                server.start()
                killed[0] += 1
                pause[0] = time.monotonic() + 2.0

        code, name = study.run(kill), "MLflow server killed (SIGKILL), started again"
        return Row.of(name, killed[0], code, whole, study)


def database_locked(stage: Stage, whole: Outcome, times: int) -> Row:
    """Hold the SQLite database's lock for longer than it is waited for."""
    study = stage.study("locked", *ONE_BY_ONE)
    locked = [0]
    pause = [time.monotonic() + 5.0]

    def lock() -> None:
        if locked[0] < times and time.monotonic() > pause[0] and study.folder.exists():
            database = sqlite3.connect(study.home.folder / "mlflow.db", timeout=30)
            database.execute("BEGIN EXCLUSIVE")
            time.sleep(8.0)
            database.rollback()
            database.close()
            locked[0] += 1
            pause[0] = time.monotonic() + 2.0

    code = study.run(lock)
    return Row.of("MLflow's database locked for 8 s", locked[0], code, whole, study)
