"""Faults of MLflow: its server killed, its database locked."""

import sqlite3
import time

from tests.commands import run_bilevel
from tests.faults.outcome import Outcome
from tests.faults.row import Row
from tests.faults.stage import ONE_BY_ONE, Stage
from tests.mlflow_shown import Server


def server_killed(stage: Stage, whole: Outcome, times: int) -> Row:
    """SIGKILL the server during the study, and restart it some seconds later. A study that ends
    meanwhile says that MLflow lacks something, and which command writes it, which is then given."""
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
        if "MLflow lacks the current state" in study.log.read_text():
            place = ("--home", study.home.folder, "--tracking-uri", server.uri)
            assert run_bilevel("sync", study.folder.name, *place).returncode == 0
        return Row.of(name, killed[0], code, whole, study)


def database_locked(stage: Stage, whole: Outcome, times: int) -> Row:
    """Hold the SQLite database's lock for longer than SQLite's timeout."""
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
