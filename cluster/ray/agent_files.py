"""Custom agents from Python files, imported by the driver and by every actor."""

import linecache
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from bilevel.agents import registered_agents
from bilevel.errors import InvalidInput


@dataclass(frozen=True)
class AgentFile:
    """A file with the content that the driver has read, for actors that start later or on machines
    without the file."""

    path: Path
    source: bytes

    def load(self) -> None:
        """Import the file. Other modules in its folder become importable."""
        name, path = self.path.stem, str(self.path)
        lines = self.source.decode().splitlines(keepends=True)
        linecache.cache[path] = (len(self.source), None, lines, path)  # for tracebacks
        sys.path.insert(0, str(self.path.parent))
        module = sys.modules[name] = ModuleType(name)
        module.__file__ = path
        try:
            exec(compile(self.source, path, "exec"), module.__dict__)
        except BaseException:
            del sys.modules[name]
            raise


#: Imported files, in the order of their import.
LOADED: list[AgentFile] = []


def load_agent_file(file: Path) -> None:
    """Import a file that registers agents, once, also in actors that start later. Raises
    InvalidInput."""
    path, known = file.resolve(), registered_agents()
    if any(agent_file.path == path for agent_file in LOADED):
        return
    if file.stem in {*sys.modules, *sys.stdlib_module_names}:
        raise InvalidInput(
            f"agent file {str(file)!r} has the name of another module, {file.stem}: rename it"
        )
    try:
        agent_file = AgentFile(path, path.read_bytes())
        agent_file.load()
    except (Exception, SystemExit) as error:
        raise InvalidInput(f"agent file {str(file)!r}: {type(error).__name__}: {error}") from None
    LOADED.append(agent_file)
    if {*registered_agents()} <= {*known}:
        raise InvalidInput(
            f"agent file {str(file)!r} registers no agent: end it with register_agent(...)"
        )


def runtime_env(local: bool) -> dict[str, Any] | None:
    """Return the `runtime_env` with which Ray's workers import the loaded agent files, or None.

    On a cluster that was joined, workers do not inherit PYTHONPATH and get its folders too.
    """
    files = [*LOADED]
    paths = [] if local else os.environ.get("PYTHONPATH", "").split(os.pathsep)
    folders = [str(Path(path).resolve()) for path in paths if path]
    if not files and not folders:
        return None

    def prepare_imports() -> None:
        sys.path[:0] = folders
        for file in files:
            with suppress(Exception, SystemExit):  # reported by the first use of the agent
                file.load()

    return {"worker_process_setup_hook": prepare_imports}
