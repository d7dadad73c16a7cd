"""MLflow's SQLite database."""

import logging
import sqlite3
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import quote

from filelock import FileLock

from bilevel.durable import sync
from bilevel.errors import InvalidInput


@contextmanager
def database_ready(uri: str) -> Iterator[None]:
    """Within the block a SQLite database is complete and locked against creation by others.

    MLflow creates the tables of a new database in many steps without a lock, and an interruption
    leaves an unusable database. So the database is created in a temporary file and renamed. Other
    URIs are ignored. Raises MLflow's exceptions and OSError.
    """
    path = _file(uri)
    if path is None:
        yield
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path.with_name(f".{path.name}.lock")):
        if not path.exists():
            _create(path)
        yield


def silence_mlflow() -> None:
    """Suppress MLflow's messages on tables and retries; errors that matter are raised."""
    for name in ("alembic", "mlflow", "mlflow.store.db.utils", "urllib3"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def _create(path: Path) -> None:
    """Make a database with MLflow's tables, and without its empty experiment `Default`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # Not by MlflowClient, which would keep the file open under its first name.
        from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore
    silence_mlflow()
    aside = path.with_name(f".{path.name}.new")
    aside.unlink(missing_ok=True)
    with _unflushed(aside):
        store = SqlAlchemyStore(f"sqlite:///{aside}", path.with_name("artifacts").as_uri())
        try:
            store.delete_experiment(store.DEFAULT_EXPERIMENT_ID)
        finally:
            store.engine.dispose()
    sync(aside)
    aside.replace(path)
    sync(path.parent)


@contextmanager
def _unflushed(path: Path) -> Iterator[None]:
    """Within the block a SQLite database is written without waiting for the disk: MLflow creates
    its tables in dozens of transactions, each of which would wait."""
    from sqlalchemy import event
    from sqlalchemy.engine import Engine

    def connected(connection: sqlite3.Connection, _: object) -> None:
        files = [Path(file) for _, _, file in connection.execute("PRAGMA database_list")]
        if files == [path.resolve()]:
            connection.execute("PRAGMA synchronous = OFF")
            connection.execute("PRAGMA journal_mode = MEMORY")

    event.listen(Engine, "connect", connected)
    try:
        yield
    finally:
        event.remove(Engine, "connect", connected)


def experiments(path: Path) -> dict[str, str]:
    """Names of the experiments in a SQLite database of MLflow's, by their ids. Raises InvalidInput
    if it is damaged."""
    query = "SELECT experiment_id, name FROM experiments WHERE lifecycle_stage = 'active'"
    try:
        with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as database:
            return {str(number): str(name) for number, name in database.execute(query)}
    except sqlite3.OperationalError as error:
        raise InvalidInput(f"MLflow's database {str(path)!r} cannot be read: {error}") from None
    except sqlite3.DatabaseError as error:
        raise InvalidInput(
            f"MLflow's database {str(path)!r} is damaged: {error}; move it away, and "
            "`bilevel sync` writes each run to a new one"
        ) from None


def require_whole(uri: str) -> None:
    """Raise InvalidInput if `uri` is a SQLite database that is damaged."""
    path = _file(uri)
    if path is not None and path.exists():
        experiments(path)


def _file(uri: str) -> Path | None:
    if not uri.startswith("sqlite"):
        return None
    from sqlalchemy.engine import make_url

    name = make_url(uri).database
    return None if name in (None, "", ":memory:") else Path(name).absolute()
