"""MLflow's SQLite database."""

import logging
import sqlite3
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from filelock import FileLock

from bilevel.durable import sync
from bilevel.errors import InvalidInput


@contextmanager
def database_ready(uri: str) -> Iterator[None]:
    """Within the block a SQLite database exists and is locked against other creators.

    MLflow creates the tables of a new database in many steps and without a lock. Therefore the
    database is created in a temporary folder and renamed. Other databases and servers are ignored.
    Raises InvalidInput for a damaged database, and MLflow's exceptions.
    """
    path = _file(uri)
    if path is None:
        yield
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path.with_name(f".{path.name}.lock")):
        if not path.exists():
            _create(path)
        _check_readable(path)
        yield


def mlflow_client(uri: str) -> Any:
    """Return an MLflow client. Log messages are suppressed; errors are raised anyway."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import mlflow
    for name in ("alembic", "mlflow", "mlflow.store.db.utils", "urllib3"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return mlflow.MlflowClient(uri, registry_uri=uri)


def experiments(path: Path) -> dict[str, str]:
    """Names of the experiments in a SQLite database by their IDs. Raises InvalidInput if the
    database is damaged."""
    _check_readable(path)
    found = mlflow_client(f"sqlite:///{path}").search_experiments(order_by=["experiment_id ASC"])
    return {experiment.experiment_id: experiment.name for experiment in found}


def _create(path: Path) -> None:
    with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as folder:
        new = Path(folder) / path.name
        mlflow_client(f"sqlite:///{new}").delete_experiment("0")  # "Default", which stays empty
        sync(new)
        new.replace(path)
    sync(path.parent)


def _check_readable(path: Path) -> None:
    """Raise InvalidInput for a damaged file. MLflow would retry for minutes."""
    try:
        with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as database:
            database.execute("PRAGMA schema_version")
    except sqlite3.OperationalError as error:
        raise InvalidInput(f"MLflow's database {str(path)!r} cannot be read: {error}") from None
    except sqlite3.DatabaseError as error:
        raise InvalidInput(
            f"MLflow's database {str(path)!r} is damaged: {error}; move it away, and "
            "`bilevel sync` writes each run to a new one"
        ) from None


def _file(uri: str) -> Path | None:
    if not uri.startswith("sqlite"):
        return None
    from sqlalchemy.engine import make_url

    name = make_url(uri).database
    return None if name in (None, "", ":memory:") else Path(name).absolute()
