"""Faults of MLflow: its server killed, its database locked."""

import sqlite3
import time

from tests.commands import run_bilevel
from tests.faults.outcome import Row
from tests.faults.stage import Injector, Stage
from tests.mlflow_shown import Server


def server_killed(stage: Stage, times: int) -> Row:
    """Kill the server during the study, and restart it some seconds later.

    If the study ends while the server is away, MLflow is updated with `bilevel sync`.
    """
    with Server(stage.folder / "server-killed") as server:
        study = stage.study("server", tracking_uri=server.uri)

        def restart() -> bool:
            server.kill()
            time.sleep(stage.chance.uniform(1.0, 4.0))
            server.start()
            return True

        injector = Injector(stage, restart, times, delay=6.0, pause=(2.0, 2.0))
        code = study.run(injector)
        if "bilevel sync" in study.log.read_text():
            place = ("--home", study.home.folder, "--tracking-uri", server.uri)
            assert run_bilevel("sync", study.folder.name, *place).returncode == 0
        title = "MLflow server killed (SIGKILL), started again"
        return stage.row(title, injector.injected, code, study)


def database_locked(stage: Stage, times: int) -> Row:
    """Hold the lock of the SQLite database for longer than SQLite's timeout."""
    study = stage.study("locked")

    def lock() -> bool:
        if not study.folder.exists():
            return False
        database = sqlite3.connect(study.home.database, timeout=30)
        database.execute("BEGIN EXCLUSIVE")
        time.sleep(8.0)
        database.rollback()
        database.close()
        return True

    injector = Injector(stage, lock, times, delay=5.0, pause=(2.0, 2.0))
    code = study.run(injector)
    return stage.row("MLflow's database locked for 8 s", injector.injected, code, study)
