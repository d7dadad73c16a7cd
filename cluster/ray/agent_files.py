"""User-defined agents from Python files, imported by the driver and every actor."""

import importlib
import os
import sys
from pathlib import Path
from typing import Any

from bilevel.errors import InvalidInput

#: Folders of the imported files, the latest first.
_FOLDERS: list[str] = []


def load_agent_file(file: Path) -> None:
    """Import a file that registers an agent.

    Its folder is put first on the module search path, here and (by `runtime_env`) in the actors,
    which import the file when the first request refers to its class. Raises InvalidInput if the
    file cannot be imported.
    """
    if not file.stem.isidentifier() or file.suffix != ".py":
        raise InvalidInput(f"agent file {str(file)!r} must be a Python file, NAME.py")
    folder = str(file.resolve().parent)
    sys.path.insert(0, folder)
    _FOLDERS.insert(0, folder)
    try:
        module = importlib.import_module(file.stem)
    except (Exception, SystemExit) as error:
        raise InvalidInput(f"agent file {str(file)!r}: {type(error).__name__}: {error}") from None
    if Path(module.__file__ or "").resolve() != file.resolve():
        raise InvalidInput(
            f"agent file {str(file)!r} has the name of another module, {module.__file__}: rename it"
        )


def runtime_env() -> dict[str, Any] | None:
    """Ray's `runtime_env` for the actors; None if no agent files were loaded."""
    if not _FOLDERS:
        return None
    others = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    return {"env_vars": {"PYTHONPATH": os.pathsep.join([*_FOLDERS, *others])}}
