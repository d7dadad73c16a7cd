"""MLflow's SQLite database."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock


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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from mlflow.store.db.utils import _initialize_tables
        from sqlalchemy import create_engine
    silence_mlflow()
    aside = path.with_name(f".{path.name}.new")
    aside.unlink(missing_ok=True)
    engine = create_engine(f"sqlite:///{aside}")
    try:
        _initialize_tables(engine)
    finally:
        engine.dispose()
    aside.replace(path)


def _file(uri: str) -> Path | None:
    if not uri.startswith("sqlite"):
        return None
    from sqlalchemy.engine import make_url

    name = make_url(uri).database
    return None if name in (None, "", ":memory:") else Path(name)
