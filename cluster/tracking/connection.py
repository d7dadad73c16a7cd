"""Connection to MLflow: valid tracking URIs, and the import of MLflow, which takes seconds."""

import os
import socket
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlparse

from bilevel.errors import InvalidInput, first_line
from cluster.storage.author import without_password
from cluster.tracking.database import database_ready, mlflow_client

_TIMEOUT = 5.0  # seconds until a server counts as unreachable
#: One thread imports at a time: SQLAlchemy's modules import each other.
_IMPORT = threading.Lock()


def check_tracking_uri(uri: str) -> None:
    """Raise InvalidInput for an unsupported URI, a server that does not answer, or a database whose
    driver is not installed."""
    shown = without_password(uri)
    invalid = InvalidInput(
        f"tracking URI {shown!r} is not valid: allowed are http(s)://host:port, "
        "sqlite:///path and other database URIs"
    )
    try:
        parts = urlparse(uri)
        port = parts.port or (443 if parts.scheme == "https" else 80)
    except ValueError:
        raise invalid from None
    if parts.scheme in ("http", "https"):
        try:
            socket.create_connection((parts.hostname or "", port), _TIMEOUT).close()
        except OSError as error:
            raise InvalidInput(f"no MLflow server at {shown!r}: {error}") from None
        return
    if uri.startswith("sqlite://"):
        return
    if parts.scheme.partition("+")[0] not in ("sqlite", "postgresql", "mysql", "mssql"):
        raise invalid
    with _IMPORT:
        from sqlalchemy.engine import make_url
        from sqlalchemy.exc import SQLAlchemyError
    try:
        make_url(uri).get_dialect().import_dbapi()
    except SQLAlchemyError:
        raise invalid from None
    except ImportError as error:
        raise InvalidInput(
            f"a tracking URI of the kind {parts.scheme}:// needs a package that is not installed "
            f"({error}): install it, or name another driver, as in postgresql+psycopg2://"
        ) from None


@contextmanager
def mlflow_imported_meanwhile() -> Iterator[None]:
    """Import MLflow in a thread while the block waits for the processes of a Ray cluster."""
    thread = threading.Thread(target=_import_mlflow, name="import mlflow")
    thread.start()
    try:
        yield
    finally:
        thread.join()  # the process must not exit during an import


def _import_mlflow() -> None:
    with _IMPORT, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import mlflow  # noqa: F401
        import sqlalchemy.orm  # noqa: F401


@contextmanager
def connected(uri: str) -> Iterator[Any]:
    """Connect to MLflow and yield a client. Within the block, a SQLite database is locked against
    other creators, and MLflow's errors become InvalidInput."""
    check_tracking_uri(uri)
    # `Mirror` retries without blocking the study.
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "30")
    os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
    _import_mlflow()
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        with database_ready(uri):
            yield mlflow_client(uri)
    except (MlflowException, SQLAlchemyError, OSError) as error:
        reason = without_password(f"MLflow at {uri!r} cannot be used: {first_line(error)}")
        raise InvalidInput(reason) from None
