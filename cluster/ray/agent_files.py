"""User-defined agents from Python files, imported by the driver and every actor."""

import importlib
import os
import sys
from collections.abc import Sequence
from importlib.abc import SourceLoader
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

from bilevel.errors import InvalidInput


class _AgentFile(SourceLoader):
    """Imports one file as it was when this process read it, here and, once pickled, elsewhere.

    So actors that start later, or on machines without the file, have the driver's version; errors
    still name the user's file.
    """

    def __init__(self, file: Path) -> None:
        self.name, self.path = file.stem, str(file.resolve())
        self.source = file.read_bytes()

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return spec_from_loader(fullname, self) if fullname == self.name else None

    def get_filename(self, fullname: str) -> str:
        return self.path

    def get_data(self, path: str | bytes) -> bytes:
        return self.source


#: The imported files, the latest first.
_FILES: list[_AgentFile] = []


def load_agent_file(file: Path) -> None:
    """Import a file that registers an agent.

    The actors import it, too (by `runtime_env`), when the first request refers to its class. Other
    modules in its folder can be imported where the folder is. Raises InvalidInput if the file
    cannot be imported.
    """
    if not file.stem.isidentifier() or file.suffix != ".py":
        raise InvalidInput(f"agent file {str(file)!r} must be a Python file, NAME.py")
    try:
        agent_file = _AgentFile(file)
        sys.path.insert(0, str(file.resolve().parent))
        sys.meta_path.insert(0, agent_file)
        _FILES.insert(0, agent_file)
        module = importlib.import_module(file.stem)
    except (Exception, SystemExit) as error:
        raise InvalidInput(f"agent file {str(file)!r}: {type(error).__name__}: {error}") from None
    if Path(module.__file__ or "").resolve() != file.resolve():
        raise InvalidInput(
            f"agent file {str(file)!r} has the name of another module, {module.__file__}: rename it"
        )


def runtime_env() -> dict[str, Any] | None:
    """Ray's `runtime_env` for the actors; None if no agent files were loaded."""
    if not _FILES:
        return None
    files = [*_FILES]

    def import_the_same() -> None:
        sys.meta_path[:0] = files

    folders = [str(Path(file.path).parent) for file in files]
    others = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    return {
        "env_vars": {"PYTHONPATH": os.pathsep.join([*folders, *others])},
        "worker_process_setup_hook": import_the_same,
    }
