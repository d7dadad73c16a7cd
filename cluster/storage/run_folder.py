"""The folder of a study or an NES run: what it is, how it stands, who works on it.

settings.json   what must stay the same, and the run's identity
standing.json   how far it is meant to go, and how its last process ended
finals.json     a line each time it ended: fresh agents' scores of its best SE
.lock           held by the process that works on it
"""

import contextlib
import json
import time
import uuid
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from filelock import FileLock, Timeout
from pydantic import Field, FiniteFloat, NonNegativeInt, PlainValidator

from bilevel.decode import decode, decode_file
from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, StorageFailure
from bilevel.tasks import Task
from cluster.storage.author import Author
from cluster.storage.lines import Lines

#: What a run may stand at; the names are MLflow's.
Status = Literal["RUNNING", "FINISHED", "KILLED", "FAILED"]

#: Seconds until a folder counts as taken: long enough for someone who just looks.
_LOCK_TIMEOUT = 1.0


@dataclass(frozen=True)
class Standing:
    """How far a run is meant to go, and how its last process ended."""

    status: Status  # RUNNING if it was never written again: the process was killed
    since: FiniteFloat  # unix time, seconds
    target: int  # brackets of a study, generations of an NES run

    @classmethod
    def load(cls, folder: Path) -> "Standing | None":
        """What the folder says, if it says anything. Raises InvalidInput if damaged."""
        path = folder / "standing.json"
        return decode_file(cls, path) if path.exists() else None

    def save(self, folder: Path) -> None:
        """Write durably. Raises StorageFailure."""
        write_aside(folder / "standing.json", json.dumps(asdict(self)).encode())

    @property
    def ended_as(self) -> Status:
        """How it stands when nobody works on it."""
        return "KILLED" if self.status == "RUNNING" else self.status


@dataclass(frozen=True)
class Begun:
    """Which run it is: what is shown elsewhere under its name belongs to it only if it
    carries the identity too."""

    # 32 hexadecimal digits, made up when it was begun.
    identity: Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
    time: FiniteFloat  # unix time, seconds
    by: Author | None = None  # unknown of runs that an early version began

    @classmethod
    def read(cls, folder: Path) -> "Begun":
        """What the folder says. Raises InvalidInput."""
        return cls.of(read_settings(folder), f"damaged settings in {str(folder)!r}")

    @classmethod
    def of(cls, settings: dict[str, Any], what: str) -> "Begun":
        """What settings say. Raises InvalidInput, in a line that begins with `what`."""
        told = {name: settings.get(key) for name, key in _BEGUN.items()}
        return decode(cls, told, what)


#: Where `settings.json` holds what is known of a run's beginning.
_BEGUN = {"identity": "identity", "time": "begun", "by": "by"}


@dataclass(frozen=True)
class Final:
    """The end of a run: what fresh agents scored on its best SE."""

    step: int  # results of a study, generations of an NES run until then
    time: float  # unix time, seconds
    metrics: dict[str, float]


def finals(folder: Path) -> list[Final]:
    """The ends of the run so far. Raises InvalidInput if damaged."""
    return Lines(folder / "finals.json").decoded(Final)


def add_final(folder: Path, final: Final) -> None:
    """Append an end, unless a process that was killed just after has done so."""
    if all(before.step != final.step for before in finals(folder)):
        Lines(folder / "finals.json").append(asdict(final))


@contextlib.contextmanager
def locked_settings(folder: Path, settings: dict[str, Any]) -> Iterator[Begun]:
    """Hold a run's folder for this process alone, and its settings to what they were.

    Raises InvalidInput if another process holds the folder, or if the run was begun
    with other settings; StorageFailure if the folder cannot be written.
    """
    path = folder / "settings.json"
    with held(folder):
        if not path.exists():
            by = asdict(Author.of_this_process())
            identified = {"identity": uuid.uuid4().hex, "begun": time.time(), "by": by, **settings}
            write_aside(path, json.dumps(identified, indent=2).encode())
        before = read_settings(folder)
        now = json.loads(json.dumps(settings))
        for name, then, value in _differences({name: before.get(name) for name in now}, now):
            raise InvalidInput(
                f"{folder.name!r} was begun with {name} = {then}, not {value}: give it that, or "
                "another name"
            )
        yield Begun.of(before, "damaged settings")


def _differences(then: Any, now: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Dotted name and both values, wherever nested settings differ."""
    if isinstance(then, dict) and isinstance(now, dict):
        for key in dict.fromkeys([*then, *now]):
            place = f"{name}.{key}" if name else key
            yield from _differences(then.get(key), now.get(key), place)
    elif then != now:
        yield name, then, now


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold a folder for this process alone; the kernel lets go when it dies.

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
    """Whether a process works on the folder."""
    if not (folder / ".lock").exists():
        return False
    lock = FileLock(folder / ".lock")
    try:
        with lock.acquire(timeout=0):
            return False
    except Timeout:
        return True


def read_settings(folder: Path) -> dict[str, Any]:
    """What a run was begun with. Raises InvalidInput if that is missing or damaged."""
    path, damaged = folder / "settings.json", "damaged settings"
    if not path.exists():
        raise InvalidInput(f"no run in {str(folder)!r}")
    settings = decode_file(dict[str, Any], path, damaged)
    Begun.of(settings, f"{damaged} {str(path)!r}")
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
    """What `settings.json` tells of every kind of run; each adds its own."""

    identity: str
    begun: float  # unix time, seconds
    by: Author | None = None
    kind: str
    task: Annotated[Task, PlainValidator(stored_task)]
    seed: NonNegativeInt
