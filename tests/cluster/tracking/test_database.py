"""MLflow's SQLite database."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.tracking.database import database_ready, experiments

_CREATE = (
    "import sys; from cluster.tracking.database import database_ready\n"
    "with database_ready(sys.argv[1]): pass"
)


def test_the_database_is_created_once_and_without_experiments(tmp_path: Path) -> None:
    path = tmp_path / "home" / "mlflow.db"
    files = []
    for _ in range(2):
        with database_ready(f"sqlite:///{path}"):
            assert experiments(path) == {}
            files.append(path.stat().st_ino)
    assert files[0] == files[1]
    assert {file.name for file in path.parent.iterdir()} <= {path.name, f".{path.name}.lock"}


def test_an_interruption_leaves_no_partial_database(tmp_path: Path) -> None:
    code = (
        "import os, signal, alembic.command\n"
        f"alembic.command.upgrade = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n{_CREATE}"
    )
    uri = f"sqlite:///{tmp_path}/mlflow.db"
    command = [sys.executable, "-W", "ignore", "-c", code, uri]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    with database_ready(uri):
        assert experiments(tmp_path / "mlflow.db") == {}


def test_a_damaged_database_is_reported(tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").write_bytes(b"no database at all, but some bytes" * 99)
    damaged = pytest.raises(InvalidInput, match="is damaged: file is not a database; move it away")
    with damaged, database_ready(f"sqlite:///{tmp_path}/mlflow.db"):
        pass
