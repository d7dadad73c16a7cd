"""The home folder, which contains one folder per run."""

import re
import shlex
import tempfile
from pathlib import Path

from bilevel.errors import InvalidInput

#: Default of `--home`.
DEFAULT_HOME = Path("runs")

#: Maximum number of characters in the name of a run.
LONGEST_NAME = 80

_NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,{LONGEST_NAME - 1}}}")


def plain_name(text: str) -> str:
    """Replace characters that names of runs and metrics may not contain by '_'."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text)


class Home:
    """The folder given by `--home`; it is created on the first write."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        if set("?%") & set(str(self.folder)):
            raise InvalidInput(f"home {str(folder)!r}: its path must not contain '?' or '%'")
        #: MLflow's database, its tracking URI, which is the default one, and its artifacts.
        self.database = self.folder / "mlflow.db"
        self.database_uri = f"sqlite:///{self.database}"
        self.artifacts = self.folder / "artifacts"

    def hint(self, command: str) -> str:
        """Return how users call `bilevel COMMAND` on this home, for messages."""
        default = self.folder == DEFAULT_HOME.resolve()
        option = "" if default else f" --home {shlex.quote(str(self.folder))}"
        return f"`bilevel {command}{option}`"

    def run_folder(self, task_id: str, name: str) -> Path:
        """Return the folder of a named run. Raises InvalidInput for a name that is not allowed."""
        if not _NAME.fullmatch(name):
            raise InvalidInput(
                f"name {name!r} is not allowed: use at most {LONGEST_NAME} letters, digits, '.', "
                "'_' and '-', starting with a letter or digit"
            )
        return self.folder / task_id.replace("/", "_") / name  # the id may have a namespace

    def runs(self) -> list[Path]:
        """Return the folders of all runs, sorted by task and name."""
        return sorted(path.parent for path in self.folder.glob("*/*/settings.json"))

    def find(self, name: str) -> Path:
        """Return the folder of the run `name` or `task/name`. Raises InvalidInput unless exactly
        one run matches."""
        names = {folder: f"{folder.parent.name}/{folder.name}" for folder in self.runs()}
        found = [folder for folder in names if name in (folder.name, names[folder])]
        if len(found) == 1:
            return found[0]
        known = ", ".join(names[folder] for folder in (found or names)) or "none yet"
        problem = "several runs are called" if found else "no run is called"
        raise InvalidInput(f"{problem} {name!r} in {str(self.folder)!r}: there are {known}")

    def prepare(self) -> None:
        """Create the folder. Raises InvalidInput if it cannot be written."""
        require_writable(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)


def require_writable(folder: Path) -> None:
    """Raise InvalidInput if a folder can be neither written nor created. Leaves no files."""
    folder = folder.absolute()
    nearest = next(path for path in (folder, *folder.parents) if path.exists())
    try:
        tempfile.TemporaryDirectory(prefix=".writable-", dir=nearest).cleanup()
    except OSError as error:
        raise InvalidInput(f"cannot write to {str(folder)!r}: {error.strerror}") from None
