"""MLflow's SQLite database: how it is made."""

from pathlib import Path

from sqlalchemy import create_engine, text

from cluster.tracking.database import _unflushed, database_ready, experiments


def flushed(path: Path) -> bool:
    """Whether new connections to a database wait for the disk."""
    engine = create_engine(f"sqlite:///{path}")
    with engine.connect() as connection:
        level = connection.execute(text("PRAGMA synchronous")).scalar()
    engine.dispose()
    return level != 0


def test_only_the_database_that_is_made_is_not_flushed(tmp_path: Path) -> None:
    made, other = tmp_path / "made.db", tmp_path / "other.db"
    with _unflushed(made):
        assert not flushed(made)
        assert flushed(other)
    assert flushed(made)


def test_it_is_made_once_and_without_an_experiment(tmp_path: Path) -> None:
    path = tmp_path / "home" / "mlflow.db"
    made = []
    for _ in range(2):
        with database_ready(f"sqlite:///{path}"):
            assert experiments(path) == {}
            made.append(path.stat().st_ino)
    assert made[0] == made[1]
    left = {file.name for file in path.parent.iterdir()} - {"artifacts"}
    assert left <= {path.name, f".{path.name}.lock"}
