"""The folder of a run: its settings, its status, and the lock of the process that works on it.

settings.json      settings that cannot change, and the run's identity
status.json        its target, and how its last process ended
finals.jsonl       a line per end of the run: scores of fresh agents on its best SE
*_se.safetensors   its SEs
.lock              held by the process that works on it
"""

import contextlib
import json
import textwrap
import time
import uuid
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from filelock import FileLock, Timeout
from pydantic import Field, FiniteFloat, NonNegativeInt, PlainValidator

from bilevel.decode import decode, decode_file, differences
from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.tasks import Task
from bilevel.version import RUN_FORMAT
from cluster.storage.author import Author
from cluster.storage.jsonl_log import JsonlLog

SETTINGS_FILE, STATUS_FILE, FINALS_FILE = "settings.json", "status.json", "finals.jsonl"

#: The result of a run, and the last SE of an NES run. Artifacts in MLflow have the same names.
BEST_FILE, LAST_FILE = "best_se.safetensors", "last_se.safetensors"

#: Status of a run, with MLflow's names.
Status = Literal["RUNNING", "FINISHED", "KILLED", "FAILED"]


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


@dataclass(frozen=True)
class RunIdentity:
    """UUID, creation time and author of a run. Its MLflow runs carry its UUID."""

    uuid: Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
    began: FiniteFloat  # unix time, seconds
    author: Author | None = None

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the identity from a run's folder. Raises InvalidInput."""
        settings = read_settings(folder)
        names = {spec.name for spec in fields(cls)} & settings.keys()
        where = f"damaged settings {str(folder / SETTINGS_FILE)!r}"
        return decode(cls, {name: settings[name] for name in names}, where)


@dataclass(frozen=True)
class Lifetime:
    """Start, end and status of a run."""

    status: Status
    began: float  # unix time, seconds
    ended: float | None  # None while it runs
    target: int = 0  # see `RunStatus`

    @classmethod
    def of(cls, folder: Path, began: float, live: bool) -> "Lifetime":
        """Return the lifetime of a run. `live`: this process works on it. Raises InvalidInput."""
        stored = RunStatus.load(folder) or RunStatus("KILLED", began, 0)
        if stored.status == "RUNNING":
            ended = None if live else stored.since
            return cls("RUNNING" if live else "KILLED", began, ended, stored.target)
        return cls(stored.status, began, stored.since, stored.target)


@dataclass(frozen=True)
class Final:
    """Scores of fresh agents on a run's best SE at one end of the run."""

    #: Results of a study, generations of an NES run, agents of an evaluation until then; SEs and
    #: agents of an experiment.
    step: int
    time: float  # unix time, seconds
    metrics: dict[str, float]
    real_env_steps: int = 0  # of the retests and last tests of this end

    def repeats(self, other: "Final") -> bool:
        """Return whether `other` records the same end."""
        return (self.step, self.metrics) == (other.step, other.metrics)


def finals(folder: Path) -> list[Final]:
    """Read the scores of all ends so far. Raises InvalidInput if damaged."""
    return JsonlLog(folder / FINALS_FILE).decoded(Final)


def add_final(folder: Path, final: Final) -> None:
    """Append an end, unless a process that was killed directly afterwards has done so."""
    log = JsonlLog(folder / FINALS_FILE)
    if not any(final.repeats(last) for last in log.decoded(Final)[-1:]):
        log.append(asdict(final))


def settings_of(kind: str, task: Task, seed: int) -> dict[str, Any]:
    """Return the settings that every kind of run has, without its identity."""
    return {"kind": kind, "task": asdict(task), "seed": seed}


@contextlib.contextmanager
def locked_settings(folder: Path, settings: dict[str, Any]) -> Iterator[RunIdentity]:
    """Lock a run's folder, and create its settings or check that they are unchanged.

    Raises InvalidInput if another process holds the folder, or if the run has other settings.
    """
    path = folder / SETTINGS_FILE
    with held(folder):
        check_settings(folder, settings)
        if not path.exists():
            identity = RunIdentity(uuid.uuid4().hex, time.time(), Author.of_this_process())
            new = {**asdict(identity), "format": RUN_FORMAT, **settings}
            write_aside(path, json.dumps(new, indent=2).encode())
        yield RunIdentity.read(folder)


def check_settings(folder: Path, settings: dict[str, Any]) -> None:
    """Raise InvalidInput if a run in the folder has other settings."""
    if not (folder / SETTINGS_FILE).exists():
        return
    stored, now = read_settings(folder), json.loads(json.dumps(settings))
    for name, *values in differences({name: stored.get(name) for name in now}, now):
        before, given = (textwrap.shorten(str(value), 60) for value in values)
        raise InvalidInput(
            f"{folder.name!r} was started with {name} = {before}, not {given}: use that value, or "
            "another name"
        )


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock a folder for this process; the kernel releases the lock when the process dies. Raises
    InvalidInput if another process holds it."""
    lock = FileLock(folder / ".lock")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=1.0)  # `is_held` takes it for a moment
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
    """Return whether a process works on the folder; False if it cannot be written."""
    try:
        with FileLock(folder / ".lock", timeout=0):
            return False
    except Timeout:
        return True
    except OSError:
        return False


def read_settings(folder: Path) -> dict[str, Any]:
    """Read a run's settings. Raises InvalidInput, and OtherVersion for another format."""
    path = folder / SETTINGS_FILE
    if not path.exists():
        raise InvalidInput(f"no run in {str(folder)!r}")
    settings = decode_file(dict[str, Any], path, "damaged settings")
    if settings.get("format", RUN_FORMAT) != RUN_FORMAT:
        raise OtherVersion(f"{folder.name!r}", settings["format"], RUN_FORMAT)
    return settings


def stored_task(facts: Any) -> Task:
    """Return the task of a run from its settings, without gymnasium, which could import a module
    that the file names. Raises InvalidInput."""
    task = decode(Task, facts, "task")
    if ".." in task.id:
        raise InvalidInput(f"task id {task.id!r} is not allowed")
    if min(task.state_size, task.action_size, task.step_limit) < 1:
        raise InvalidInput("the task's sizes are not positive")
    return task


@dataclass(frozen=True, kw_only=True)
class Settings(RunIdentity):
    """Settings that every kind of run has; each kind adds its own."""

    format: int
    kind: str
    task: Annotated[Task, PlainValidator(stored_task)]
    seed: NonNegativeInt

    #: The kind of run in messages.
    noun: ClassVar[str]

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the settings in a run's folder. Raises InvalidInput."""
        return decode(cls, read_settings(folder), f"{str(folder)!r} holds no {cls.noun}")
