"""The connection to MLflow: which addresses are valid, and its import, which takes seconds."""

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
from cluster.tracking.database import database_ready, require_whole, silence_mlflow

_TIMEOUT = 5.0  # seconds until a server counts as unreachable
#: Two threads that import SQLAlchemy at once see incomplete modules.
_IMPORT = threading.Lock()


def check_tracking_uri(uri: str) -> None:
    """Raise InvalidInput if `uri` is of no known kind, its server does not answer, or its database
    needs a package that is not installed."""
    shown = without_password(uri)
    not_valid = InvalidInput(
        f"tracking URI {shown!r} is not valid: allowed are http(s)://host:port, "
        "sqlite:///path and other database URIs"
    )
    try:
        parts = urlparse(uri)
    except ValueError:
        raise not_valid from None
    if parts.scheme in ("http", "https"):
        try:
            port = parts.port or (443 if parts.scheme == "https" else 80)
            socket.create_connection((parts.hostname or "", port), _TIMEOUT).close()
        except (OSError, ValueError) as error:
            raise InvalidInput(f"no MLflow server at {shown!r}: {error}") from None
        return
    if parts.scheme == "sqlite" and uri.startswith("sqlite://"):
        return
    if parts.scheme.partition("+")[0] not in ("sqlite", "postgresql", "mysql", "mssql"):
        raise not_valid
    try:
        with _IMPORT:
            _require_driver(uri)
    except InvalidInput:
        raise
    except ValueError:
        raise not_valid from None


def _require_driver(uri: str) -> None:
    """Raise ValueError if `uri` is no database's address, and InvalidInput if the package that
    talks to such a database is missing."""
    from sqlalchemy.engine import make_url
    from sqlalchemy.exc import ArgumentError, NoSuchModuleError

    try:
        make_url(uri).get_dialect().import_dbapi()
    except (ArgumentError, NoSuchModuleError) as error:
        raise ValueError(str(error)) from None
    except ImportError as error:
        kind = uri.partition("://")[0]
        raise InvalidInput(
            f"a tracking URI of the kind {kind}:// needs a package that is not installed "
            f"({error}): install it beside bilevel, or name another driver, as in "
            "postgresql+psycopg2://"
        ) from None


@contextmanager
def mlflow_imported_meanwhile() -> Iterator[None]:
    """Import MLflow in a thread during the block: the import takes seconds, in which the caller
    waits for the processes of a Ray cluster anyway."""
    thread = threading.Thread(target=_import_mlflow, name="import mlflow")
    thread.start()
    try:
        yield
    finally:
        thread.join()  # the process must not end during an import


def _import_mlflow() -> None:
    with _IMPORT, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import mlflow
        import mlflow.store.tracking.sqlalchemy_store  # noqa: F401


@contextmanager
def connected(uri: str) -> Iterator[Any]:
    """A client of the MLflow at `uri`. Within the block a SQLite database is locked against
    creation by others, and MLflow's errors become InvalidInput."""
    check_tracking_uri(uri)
    # The caller retries, without blocking the study.
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "30")
    os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
    _import_mlflow()
    import mlflow
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    silence_mlflow()
    try:
        with database_ready(uri):
            yield mlflow.MlflowClient(uri, registry_uri=uri)
    except (MlflowException, SQLAlchemyError, OSError) as error:
        require_whole(uri)
        told = without_password(f"MLflow at {uri!r} cannot be used: {first_line(error)}")
        raise InvalidInput(told) from None
