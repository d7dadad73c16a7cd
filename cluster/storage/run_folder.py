"""The folder of a run: its settings, its status, and the lock of the process that works on it.

settings.json      settings that must stay the same, and the run's identity
status.json        its target, and how its last process ended
finals.jsonl       a line each time it ended: fresh agents' scores of its best SE
*_se.safetensors   its SEs
.lock              held by the process that works on it
"""

import contextlib
import fcntl
import json
import os
import textwrap
import time
import uuid
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from filelock import FileLock, Timeout
from pydantic import Field, FiniteFloat, NonNegativeInt, PlainValidator

from bilevel.agents import get_agent
from bilevel.decode import decode, decode_file, differences
from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.tasks import Task
from bilevel.version import RUN_FORMAT
from cluster.storage.author import Author
from cluster.storage.jsonl_log import JsonlLog

#: Longest value that a message tells.
_TOLD = 60

SETTINGS_FILE, STATUS_FILE, FINALS_FILE = "settings.json", "status.json", "finals.jsonl"

#: The SE that a run hands over, the last one of an NES run, and the best one so far of an
#: interrupted study's incumbent; also their names among the run's artifacts.
BEST_FILE, LAST_FILE = "best_se.safetensors", "last_se.safetensors"
INCUMBENT_FILE = "incumbent_se.safetensors"
USUAL_FILES = {BEST_FILE, LAST_FILE, INCUMBENT_FILE}

#: Status of a run; the names are MLflow's.
Status = Literal["RUNNING", "FINISHED", "KILLED", "FAILED"]

#: Seconds until a folder counts as taken: long enough for someone who just looks.
_LOCK_TIMEOUT = 1.0


@dataclass(frozen=True)
class RunStatus:
    """Target of a run, and how the last process that worked on it ended."""

    status: Status  # RUNNING if that process was killed
    since: FiniteFloat  # unix time, seconds
    target: int  # brackets of a study, generations of an NES run, agents of an evaluation

    @classmethod
    def load(cls, folder: Path) -> "RunStatus | None":
        """Read the status; None if the run has none yet. Raises InvalidInput if damaged."""
        path = folder / STATUS_FILE
        return decode_file(cls, path) if path.exists() else None

    def save(self, folder: Path) -> None:
        """Write durably. Raises StorageFailure."""
        write_aside(folder / STATUS_FILE, json.dumps(asdict(self)).encode())

    @property
    def ended_as(self) -> Status:
        """Status while no process holds the run's lock."""
        return "KILLED" if self.status == "RUNNING" else self.status


@dataclass(frozen=True)
class RunIdentity:
    """UUID, creation time, author and code of a run. MLflow runs belong to it if they carry its
    UUID."""

    uuid: Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
    began: FiniteFloat  # unix time, seconds
    author: Author | None = None
    #: Digests of the versions of users' own code that it has run, by task and agent.
    code: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def mixture(self) -> str:
        """A sentence if it has run several versions of the code of an agent or a task, else ''."""
        mixed = [f"{len(v)} versions of the {what}" for what, v in self.code.items() if len(v) > 1]
        told = " and ".join(mixed)
        return f"Begun and resumed with {told}, whose results may differ" if mixed else ""

    @classmethod
    def read(cls, folder: Path) -> "RunIdentity":
        """Read it from a run's folder. Raises InvalidInput."""
        return cls.of(read_settings(folder), f"damaged settings in {str(folder)!r}")

    @classmethod
    def of(cls, settings: dict[str, Any], what: str) -> "RunIdentity":
        """Read it from settings. Raises InvalidInput, in a line that begins with `what`."""
        names = [spec.name for spec in fields(cls)]
        return decode(cls, {name: settings[name] for name in names if name in settings}, what)


@dataclass(frozen=True)
class Lifetime:
    """When a run began and ended, and what has become of it."""

    status: Status
    began: float  # unix time, seconds
    ended: float | None  # None while it runs
    target: int = 0  # see `RunStatus`

    @classmethod
    def of(cls, folder: Path, began: float, live: bool) -> "Lifetime":
        """The lifetime of the run in a folder; `live` is whether this process works on it. Raises
        InvalidInput if its status is damaged."""
        stored = RunStatus.load(folder) or RunStatus("KILLED", began, 0)
        if live and stored.status == "RUNNING":
            return cls("RUNNING", began, None, stored.target)
        return cls(stored.ended_as, began, stored.since, stored.target)

    @property
    def over(self) -> bool:
        """Whether no process works on the run."""
        return self.ended is not None


@dataclass(frozen=True)
class Final:
    """Scores of fresh agents on a run's best SE, each time that the run ended."""

    #: Results of a study, generations of an NES run, agents of an evaluation until then; SEs and
    #: agents of an experiment.
    step: int
    time: float  # unix time, seconds
    metrics: dict[str, float]
    real_env_steps: int = 0  # of this end: retests and last tests

    def repeats(self, other: "Final") -> bool:
        """Whether it is the same end, which was written again."""
        return (self.step, self.metrics) == (other.step, other.metrics)


def finals(folder: Path) -> list[Final]:
    """Read the scores of all ends so far. Raises InvalidInput if damaged."""
    return JsonlLog(folder / FINALS_FILE).decoded(Final)


def add_final(folder: Path, final: Final) -> None:
    """Append an end, unless an earlier process did so just before it was killed."""
    before = finals(folder)
    if not before or not final.repeats(before[-1]):
        JsonlLog(folder / FINALS_FILE).append(asdict(final))


def settings_of(kind: str, task: Task, seed: int, agents: Iterable[str]) -> dict[str, Any]:
    """The settings that every kind of run has, without its identity; `code` has the digests of
    users' own code that it runs. Raises InvalidInput for an unknown agent."""
    digests = {f"task {task.id!r}": task.code_digest}
    digests |= {f"agent {name!r}": get_agent(name).code_digest for name in agents}
    code = {what: [digest] for what, digest in digests.items() if digest is not None}
    return {"kind": kind, "task": asdict(task), "seed": seed, "code": code}


@contextlib.contextmanager
def locked_settings(folder: Path, settings: dict[str, Any]) -> Iterator[RunIdentity]:
    """Lock a run's folder, and create its settings or check that they are unchanged. Users' own
    code may have changed, for a mistake may have been mended: its versions are kept.

    Raises InvalidInput if another process holds the folder, or if the run was begun
    with other settings; StorageFailure if the folder cannot be written.
    """
    path = folder / SETTINGS_FILE
    with held(folder):
        if not path.exists():
            identity = RunIdentity(uuid.uuid4().hex, time.time(), Author.of_this_process())
            identified = {**asdict(identity), "format": RUN_FORMAT, **settings}
            write_aside(path, json.dumps(identified, indent=2).encode())
        stored, code = _unchanged(folder, settings), settings.get("code", {})
        identity = RunIdentity.of(stored, "damaged settings")
        versions = {
            what: tuple(dict.fromkeys([*identity.code.get(what, ()), *now]))
            for what, now in code.items()
        }
        if versions.items() - identity.code.items():
            identity = replace(identity, code=identity.code | versions)
            write_aside(path, json.dumps({**stored, "code": identity.code}, indent=2).encode())
        yield identity


def check_settings(folder: Path, settings: dict[str, Any]) -> None:
    """Raise InvalidInput if a run in the folder was begun with other settings."""
    if (folder / SETTINGS_FILE).exists():
        _unchanged(folder, settings)


def _unchanged(folder: Path, settings: dict[str, Any]) -> dict[str, Any]:
    before = read_settings(folder)
    now = json.loads(json.dumps({k: v for k, v in settings.items() if k != "code"}))
    for name, then, value in differences({name: before.get(name) for name in now}, now):
        told, asked = (textwrap.shorten(str(one), _TOLD) for one in (then, value))
        raise InvalidInput(
            f"{folder.name!r} was begun with {name} = {told}, not {asked}: use that value, or "
            "another name"
        )
    return before


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock a folder for this process; the kernel releases the lock when the process dies.

    Raises InvalidInput if another process holds it, StorageFailure if it cannot be
    written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / ".lock")
        lock.acquire(timeout=_LOCK_TIMEOUT)
    except Timeout:
        raise InvalidInput(f"{folder.name!r} is being run by another process") from None
    except OSError as error:
        raise StorageFailure.of(folder, error) from None
    try:
        for stray in folder.rglob(".*.tmp"):  # of a process that was killed while writing
            with contextlib.suppress(OSError):
                stray.unlink()
        yield
    finally:
        lock.release()


def is_held(folder: Path) -> bool:
    """Whether a process works on the folder, as far as one can tell that may only read it."""
    path = folder / ".lock"
    try:
        lock = os.open(path, os.O_RDWR)  # NFS locks only what is open for writing
    except FileNotFoundError:
        return False
    except OSError:
        lock = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # as FileLock does
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(lock)
    return False


def read_settings(folder: Path) -> dict[str, Any]:
    """Read a run's settings. Raises InvalidInput if they are missing or damaged, OtherVersion if
    they have another format."""
    path, damaged = folder / SETTINGS_FILE, "damaged settings"
    if not path.exists():
        raise InvalidInput(f"no run in {str(folder)!r}")
    settings = decode_file(dict[str, Any], path, damaged)
    # The settings of a run name its task; the first versions wrote no format.
    written = settings.get("format", 1 if "task" in settings else RUN_FORMAT)
    if isinstance(written, int) and written != RUN_FORMAT:
        raise OtherVersion(f"{folder.name!r}", written, RUN_FORMAT)
    RunIdentity.of(settings, f"{damaged} {str(path)!r}")
    return settings


def stored_task(facts: Any) -> Task:
    """The task that a run was begun on, from the facts in its settings alone: asking
    gymnasium for it could import what the file names. Raises InvalidInput."""
    task = decode(Task, facts, "task")
    if ".." in task.id:
        raise InvalidInput(f"task id {task.id!r} is not allowed")
    if min(task.state_size, task.n_actions, task.step_limit) < 1:
        raise InvalidInput("the task's sizes are not positive")
    return task


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings that every kind of run has; each kind adds its own."""

    uuid: str
    began: float  # unix time, seconds
    author: Author | None = None
    format: int
    kind: str
    task: Annotated[Task, PlainValidator(stored_task)]
    seed: NonNegativeInt
    code: dict[str, tuple[str, ...]] = field(default_factory=dict)
