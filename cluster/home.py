"""Where things lie on disk: one folder for all runs, a folder each within."""

import contextlib
import json
import re
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from bilevel.errors import InvalidInput
from bilevel.synthetic_env.storage import write_aside

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")


class Home:
    """The folder given by `--home`; created when something is first put there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()

    @property
    def database_uri(self) -> str:
        """Tracking URI of the SQLite database that serves when none is given."""
        return f"sqlite:///{self.folder / 'mlflow.db'}"

    @property
    def artifacts(self) -> Path:
        """Where that database's artifacts lie."""
        return self.folder / "artifacts"

    def run_folder(self, task_id: str, name: str) -> Path:
        """Folder of a named study or NES run.

        Raises InvalidInput for a name that could lead out of it.
        """
        if not _NAME.fullmatch(name):
            raise InvalidInput(
                f"name {name!r} is not allowed: letters, digits, '.', '_' and '-', at most 80, "
                "beginning with a letter or digit"
            )
        return self.folder / task_id.replace("/", "_") / name

    def prepare(self) -> None:
        """Create the folder. Raises InvalidInput if it cannot be written."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            probe = self.folder / ".writable"
            probe.touch()
            probe.unlink()
        except OSError as error:
            reason = error.strerror or str(error)
            raise InvalidInput(f"cannot write to {str(self.folder)!r}: {reason}") from None


@contextlib.contextmanager
def locked_settings(folder: Path, settings: dict[str, Any]) -> Iterator[str]:
    """Hold a run's folder for this process alone, and its settings to what they were.

    Yields the run's identity, a string made up when it was begun: what is tracked
    elsewhere under its name belongs to it only if it carries the identity too.
    Raises InvalidInput if another process holds the folder, or if the run was begun
    with other settings.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / ".lock", timeout=0):
            path = folder / "settings.json"
            if not path.exists():
                identified = {"identity": uuid.uuid4().hex, **settings}
                write_aside(path, json.dumps(identified, indent=2).encode())
            yield _require_same(path, settings)
    except Timeout:
        raise InvalidInput(f"{folder.name!r} is being run by another process") from None


def _require_same(path: Path, settings: dict[str, Any]) -> str:
    try:
        before = json.loads(path.read_bytes())
        before["identity"]
    except (ValueError, TypeError, KeyError) as error:
        raise InvalidInput(f"damaged settings {str(path)!r}: {error}") from None
    for name, value in json.loads(json.dumps(settings)).items():
        if before.get(name) != value:
            raise InvalidInput(
                f"{path.parent.name!r} was begun with {name} = {before.get(name)}, not {value}: "
                "give it that, or another name"
            )
    return str(before["identity"])
