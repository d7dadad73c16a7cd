"""Connection to MLflow: valid tracking URIs, and the import of MLflow, which takes seconds."""

import logging
import os
import socket
import sqlite3
import tempfile
import threading
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

from filelock import FileLock

from bilevel.durable import sync
from bilevel.errors import InvalidInput, first_line
from cluster.storage.author import without_password

_DATABASES = ("sqlite:///", "sqlite+", "postgresql", "mysql", "mssql")
_TIMEOUT = 5.0  # seconds until a server counts as unreachable
#: One thread imports at a time: SQLAlchemy's modules import each other.
_IMPORT = threading.Lock()


def check_tracking_uri(uri: str) -> None:
    """Raise InvalidInput for an unsupported URI or a server that does not answer."""
    shown = without_password(uri)
    if uri.startswith(_DATABASES):
        return
    try:
        parts = urlparse(uri)
        port = parts.port or (443 if parts.scheme == "https" else 80)
        supported = parts.scheme in ("http", "https")
    except ValueError:
        supported = False
    if not supported:
        raise InvalidInput(
            f"tracking URI {shown!r} is not valid: allowed are http(s)://host:port, "
            "sqlite:///path and other database URIs"
        )
    try:
        socket.create_connection((parts.hostname or "", port), _TIMEOUT).close()
    except OSError as error:
        raise InvalidInput(f"no MLflow server at {shown!r}: {error}") from None


def preload_mlflow() -> None:
    """Import MLflow in a thread, while this one waits for the processes of a Ray cluster."""
    threading.Thread(target=_import_mlflow, name="import mlflow").start()


def _import_mlflow() -> None:
    with _IMPORT, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import mlflow  # noqa: F401
        import sqlalchemy.orm  # noqa: F401


@contextmanager
def mlflow_errors(uri: str) -> Iterator[None]:
    """Raise MLflow's errors in the block as InvalidInput."""
    _import_mlflow()
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError, ImportError, OSError) as error:
        reason = without_password(f"MLflow at {uri!r} cannot be used: {first_line(error)}")
        raise InvalidInput(reason) from None


@contextmanager
def connected(uri: str) -> Iterator[Any]:
    """Connect to MLflow and yield a client. Within the block, a SQLite database is locked against
    other creators, and MLflow's errors become InvalidInput."""
    check_tracking_uri(uri)
    # `Mirror` retries without blocking the study.
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "30")
    os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
    with mlflow_errors(uri):
        if not uri.startswith("sqlite"):
            yield _client(uri)
            return
        path = Path(uri.partition(":///")[2].partition("?")[0]).absolute()
        path.parent.mkdir(parents=True, exist_ok=True)
        # MLflow creates the tables of a new database in many steps and without a lock.
        with FileLock(path.with_name(f".{path.name}.lock")):
            if path.exists():
                _check_readable(path)
            else:
                _create(path)
            yield _client(uri)


def _client(uri: str) -> Any:
    """Return an MLflow client. Log messages are suppressed; errors are raised anyway."""
    import mlflow

    for name in ("alembic", "mlflow", "mlflow.store.db.utils", "urllib3"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return mlflow.MlflowClient(uri, registry_uri=uri)


def _create(path: Path) -> None:
    """Create a database aside and rename it, so that a killed process leaves no half of one."""
    with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as folder:
        new = Path(folder) / path.name
        _client(f"sqlite:///{new}").delete_experiment("0")  # "Default", which stays empty
        sync(new)
        new.replace(path)
    sync(path.parent)


def _check_readable(path: Path) -> None:
    """Raise InvalidInput for a damaged database. MLflow would retry for minutes."""
    try:
        with closing(sqlite3.connect(path)) as database:
            database.execute("PRAGMA schema_version")
    except sqlite3.DatabaseError as error:
        raise InvalidInput(
            f"MLflow's database {str(path)!r} cannot be read: {error}; if it is damaged, move it "
            "away and write each run to a new one with `bilevel sync`"
        ) from None
