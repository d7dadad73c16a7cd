"""User-defined agents from Python files, imported by the driver and every actor."""

import importlib
import linecache
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.abc import SourceLoader
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

from bilevel.agents import registered_agents
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

    def exec_module(self, module: ModuleType) -> None:
        lines = (self.get_source(self.name) or "").splitlines(keepends=True)
        linecache.cache[self.path] = (len(self.source), None, lines, self.path)  # for messages
        super().exec_module(module)


#: The imported files, the latest first.
_FILES: list[_AgentFile] = []


def load_agent_file(file: Path) -> tuple[str, ...]:
    """Import a file that registers an agent, or several; return their names, none if this process
    has imported it before. The actors will import it, too (by `runtime_env`).

    Other modules in its folder can be imported where the folder is. Raises InvalidInput if the file
    cannot be imported, registers no agent, or has the name of another module.
    """
    if not file.stem.isidentifier() or file.suffix != ".py":
        raise InvalidInput(f"agent file {str(file)!r} must be a Python file, NAME.py")
    before, again = registered_agents(), file.stem in sys.modules
    try:
        agent_file = _AgentFile(file)
        other = _namesake(agent_file)
        if other is None:
            _import_first([agent_file])
            _FILES.insert(0, agent_file)
            importlib.import_module(file.stem)
    except (Exception, SystemExit) as error:
        raise InvalidInput(f"agent file {str(file)!r}: {type(error).__name__}: {error}") from None
    if other is not None:
        raise InvalidInput(
            f"agent file {str(file)!r} has the name of another module, {other}: rename it"
        )
    registered = tuple(name for name in registered_agents() if name not in before)
    if not registered and not again:
        raise InvalidInput(
            f"agent file {str(file)!r} registers no agent: end it with register_agent(...)"
        )
    return registered


def loaded_files() -> list[str]:
    """Paths of the files, in the order in which they were loaded."""
    return [file.path for file in reversed(_FILES)]


def _namesake(file: _AgentFile) -> str | None:
    """Where another module of that name is, if there is one: it would be imported in place of the
    file, or the file in place of it."""
    folder = Path(file.path).parent
    if file.name in sys.modules:
        found = sys.modules[file.name].__spec__
    else:
        others = [path for path in sys.path if Path(path).resolve() != folder]
        found = PathFinder.find_spec(file.name, others)
    origin = None if found is None else found.origin  # None: a folder that is no package
    return None if origin is None or Path(origin).resolve() == Path(file.path) else origin


def _import_first(files: Sequence[_AgentFile]) -> None:
    """Let imports find these files, and then what is in their folders, before all else."""
    sys.meta_path[:0] = files
    sys.path[:0] = [str(Path(file.path).parent) for file in files]


def runtime_env(own: bool) -> dict[str, Any] | None:
    """Ray's `runtime_env`, by which actors import what this process does: the agent files that were
    loaded and, unless the cluster is this command's `own`, what PYTHONPATH finds. None if there is
    nothing to tell them."""
    files = [*_FILES]
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    # The processes of a cluster that is joined have another environment.
    given = [] if own else [str(Path(path).resolve()) for path in paths if path]
    if not files and not given:
        return None

    def import_the_same() -> None:
        sys.path[:0] = given
        _import_first(files)
        for file in reversed(files):
            with suppress(Exception, SystemExit):  # told where the agent is needed
                importlib.import_module(file.name)

    return {"worker_process_setup_hook": import_the_same}
