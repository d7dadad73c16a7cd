"""The connection to MLflow."""

from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.tracking.connection import connected


def test_a_new_database_has_no_experiments(tmp_path: Path) -> None:
    for _ in range(2):
        with connected(f"sqlite:///{tmp_path}/home/mlflow.db") as client:
            assert client.search_experiments() == []


def test_a_damaged_database_is_reported(tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").write_bytes(b"no database at all, but some bytes" * 99)
    damaged = pytest.raises(InvalidInput, match="file is not a database; if it is damaged, move")
    with damaged, connected(f"sqlite:///{tmp_path}/mlflow.db"):
        pass


def test_a_missing_driver_is_reported() -> None:
    missing = pytest.raises(InvalidInput, match=r"MLflow at 'mssql\+.*' cannot be used")
    with missing, connected("mssql+pymssql://user:secret@localhost/mlflow"):
        pass
