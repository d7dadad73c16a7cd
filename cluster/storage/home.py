"""The home folder: one folder for all runs, with one folder per run."""

import errno
import glob
import os
import re
import shlex
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import bilevel
from bilevel.errors import InvalidInput, first_line

#: The home of commands that name none.
DEFAULT_HOME = Path("runs")

#: Maximum number of characters in a name.
LONGEST_NAME = 80

_NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,{LONGEST_NAME - 1}}}")


def plain_name(text: str) -> str:
    """The text as a run or a metric may be named: what is not allowed is replaced by '_'."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text)


class Home:
    """The folder given by `--home`; it is created when it is first written to.

    Raises InvalidInput for a path that cannot be a folder's, or that the address of its database
    could not hold.
    """

    def __init__(self, folder: Path) -> None:
        try:
            self.folder = folder.resolve()
            with suppress(FileNotFoundError):
                if not stat.S_ISDIR(self.folder.stat().st_mode):
                    raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        except PermissionError:
            raise
        except (OSError, RuntimeError) as error:  # RuntimeError: a loop of links
            reason = first_line(error)
            raise InvalidInput(f"the folder {str(folder)!r} cannot be a home: {reason}") from None
        if set("?%") & set(str(self.folder)):
            raise InvalidInput(
                f"the folder {str(self.folder)!r} cannot be a home: its path must have no ? and %"
            )

    def hint(self, command: str, target: str | None = None) -> str:
        """`bilevel COMMAND` on this home as its user types it: the Makefile's `target` in the
        project's own folder, unless there is none or the home is another one."""
        usual = self.folder == DEFAULT_HOME.resolve()
        if target is not None and usual and Path.cwd() == Path(bilevel.__file__).parents[1]:
            return f"`make {target}`"
        program = "bilevel" if shutil.which("bilevel") else shlex.quote(sys.argv[0])
        return f"`{program} {command}{'' if usual else f' --home {shlex.quote(str(self.folder))}'}`"

    @property
    def database(self) -> Path:
        """File of the home's own MLflow database."""
        return self.folder / "mlflow.db"

    @property
    def database_uri(self) -> str:
        """Tracking URI of the home's SQLite database, the default for tracking."""
        return f"sqlite:///{self.database}"

    @property
    def artifacts(self) -> Path:
        """Folder of the artifacts of that database."""
        return self.folder / "artifacts"

    def run_folder(self, task_id: str, name: str) -> Path:
        """Folder of a named run.

        Raises InvalidInput for a name that is not allowed: it could lead out of the home.
        """
        if not _NAME.fullmatch(name):
            raise InvalidInput(
                f"name {name!r} is not allowed: letters, digits, '.', '_' and '-', at most "
                f"{LONGEST_NAME}, beginning with a letter or digit (--name, of studies --study)"
            )
        return self.folder / _of_task(task_id) / name

    def runs(self, task_id: str | None = None) -> list[Path]:
        """Folders of all runs, or of those on one task, by task and name."""
        if self.folder.is_dir():
            os.scandir(self.folder).close()  # a folder that cannot be read would look empty
        tasks = "*" if task_id is None else glob.escape(_of_task(task_id))
        return sorted(path.parent for path in self.folder.glob(f"{tasks}/*/settings.json"))

    def find(self, name: str) -> Path:
        """Folder of the run `name`, or `task/name` if several tasks have that name.

        Raises InvalidInput unless exactly one run matches.
        """
        found = [
            folder
            for folder in self.runs()
            if name in (folder.name, f"{folder.parent.name}/{folder.name}")
        ]
        if len(found) == 1:
            return found[0]
        known = ", ".join(f"{f.parent.name}/{f.name}" for f in (found or self.runs())) or "none yet"
        what = "several runs are called" if found else "no run is called"
        raise InvalidInput(f"{what} {name!r} in {str(self.folder)!r}: there are {known}")

    def prepare(self) -> None:
        """Create the folder. Raises InvalidInput if it cannot be written."""
        require_writable(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)


def require_writable(folder: Path) -> None:
    """Raise InvalidInput if a folder can be neither written nor created; nothing stays."""
    folder = folder.absolute()
    nearest = next(path for path in (folder, *folder.parents) if path.exists())
    try:
        tempfile.TemporaryDirectory(prefix=".writable-", dir=nearest).cleanup()
    except OSError as error:
        reason = error.strerror or str(error)
        raise InvalidInput(f"cannot write to {str(folder)!r}: {reason}") from None


def _of_task(task_id: str) -> str:
    """Name of the folder of a task's runs; a gymnasium id may have a namespace."""
    return task_id.replace("/", "_")
