"""Custom agents from Python files, imported by the driver and by every actor."""

import linecache
import os
import sys
from contextlib import suppress
from importlib.abc import SourceLoader
from importlib.machinery import PathFinder
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import Any

from bilevel.agents import registered_agents
from bilevel.errors import InvalidInput


class AgentFile(SourceLoader):
    """Import one file with the content that the driver has read.

    Pickled copies give the same version to actors that start later or on machines without the file.
    """

    def __init__(self, file: Path) -> None:
        self.name, self.path = file.stem, str(file.resolve())
        self.source = file.read_bytes()

    def get_filename(self, fullname: str) -> str:
        return self.path

    def get_data(self, path: str | bytes) -> bytes:
        return self.source

    def load(self) -> None:
        """Import the file. Other modules in its folder become importable."""
        lines = self.source.decode().splitlines(keepends=True)
        linecache.cache[self.path] = (len(self.source), None, lines, self.path)  # for tracebacks
        sys.path.insert(0, str(Path(self.path).parent))
        spec = spec_from_loader(self.name, self)
        assert spec is not None
        module = sys.modules[self.name] = module_from_spec(spec)
        try:
            self.exec_module(module)
        except BaseException:
            del sys.modules[self.name]
            raise


#: Imported files, in the order of their import.
LOADED: list[AgentFile] = []


def load_agent_file(file: Path) -> tuple[str, ...]:
    """Import a file that registers agents, also in actors that start later, and return the names of
    the agents. The result is empty if this process has already imported the file.

    Raises InvalidInput if the file cannot be imported, registers no agent, or shares its name with
    another module.
    """
    if not file.stem.isidentifier() or file.suffix != ".py":
        raise InvalidInput(f"agent file {str(file)!r} must be a Python file, NAME.py")
    known, loaded = registered_agents(), sys.modules.get(file.stem)
    try:
        elsewhere = [path for path in sys.path if Path(path).resolve() != file.resolve().parent]
        spec = loaded.__spec__ if loaded else PathFinder.find_spec(file.stem, elsewhere)
        origin = None if spec is None else spec.origin
        if origin is not None and Path(origin).resolve() != file.resolve():
            raise InvalidInput(f"it has the name of another module, {origin}: rename it")
        if loaded:
            return ()
        agent_file = AgentFile(file)
        agent_file.load()
    except InvalidInput as error:
        raise InvalidInput(f"agent file {str(file)!r}: {error}") from None
    except (Exception, SystemExit) as error:
        raise InvalidInput(f"agent file {str(file)!r}: {type(error).__name__}: {error}") from None
    LOADED.append(agent_file)
    registered = tuple(name for name in registered_agents() if name not in known)
    if not registered:
        raise InvalidInput(
            f"agent file {str(file)!r} registers no agent: end it with register_agent(...)"
        )
    return registered


def runtime_env(local: bool) -> dict[str, Any] | None:
    """Return the `runtime_env` with which Ray's workers import what this process imports, or None.

    Workers import the loaded agent files. On a cluster that was joined, they also search the
    folders in PYTHONPATH; workers of a `local` cluster inherit the variable.
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
