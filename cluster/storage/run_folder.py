"""The folder of a study or an NES run: what it is, how it stands, who works on it.

settings.json   what must stay the same, and the run's identity
standing.json   how far it is meant to go, and how its last process ended
finals.json     a line each time it ended: fresh agents' scores of its best SE
.lock           held by the process that works on it
"""

import contextlib
import json
import math
import re
import time
import uuid
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, StorageFailure, one_of
from bilevel.tasks import Task
from cluster.storage.lines import Lines

#: What a run may stand at; the names are MLflow's.
STATUSES = ("RUNNING", "FINISHED", "KILLED", "FAILED")

#: Seconds until a folder counts as taken: long enough for someone who just looks.
_LOCK_TIMEOUT = 1.0


@dataclass(frozen=True)
class Standing:
    """How far a run is meant to go, and how its last process ended."""

    status: str  # RUNNING if it was never written again: the process was killed
    since: float  # unix time, seconds
    target: int  # brackets of a study, generations of an NES run

    @classmethod
    def load(cls, folder: Path) -> "Standing | None":
        """What the folder says, if it says anything. Raises InvalidInput if damaged."""
        path = folder / "standing.json"
        if not path.exists():
            return None
        try:
            standing = cls(**json.loads(path.read_bytes()))
            if standing.status not in STATUSES:
                raise one_of("status", standing.status, STATUSES)
            if type(standing.target) is not int or not math.isfinite(standing.since):
                raise ValueError("its values are of another kind")
        except (OSError, ValueError, TypeError, RecursionError) as error:
            raise InvalidInput(f"damaged {str(path)!r}: {error}") from None
        return standing

    def save(self, folder: Path) -> None:
        """Write durably. Raises StorageFailure."""
        write_aside(folder / "standing.json", json.dumps(asdict(self)).encode())

    @property
    def ended_as(self) -> str:
        """How it stands when nobody works on it."""
        return "KILLED" if self.status == "RUNNING" else self.status


@dataclass(frozen=True)
class Begun:
    """Which run it is: what is shown elsewhere under its name belongs to it only if it
    carries the identity too."""

    identity: str  # a string made up when it was begun
    time: float  # unix time, seconds

    @classmethod
    def read(cls, folder: Path) -> "Begun":
        """What the folder says. Raises InvalidInput."""
        settings = read_settings(folder)
        return cls(settings["identity"], settings["begun"])


@dataclass(frozen=True)
class Final:
    """The end of a run: what fresh agents scored on its best SE."""

    step: int  # results of a study, generations of an NES run until then
    time: float  # unix time, seconds
    metrics: dict[str, float]


def finals(folder: Path) -> list[Final]:
    """The ends of the run so far. Raises InvalidInput if damaged."""
    file = Lines(folder / "finals.json")
    found = []
    for index, value in enumerate(file.values):
        try:
            final = Final(int(value["step"]), float(value["time"]), dict(value["metrics"]))
            if not all(isinstance(number, int | float) for number in final.metrics.values()):
                raise TypeError("a metric is not a number")
        except (ValueError, TypeError, KeyError, OverflowError) as error:
            raise file.damaged(index, error) from None
        found.append(final)
    return found


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
            identified = {"identity": uuid.uuid4().hex, "begun": time.time(), **settings}
            write_aside(path, json.dumps(identified, indent=2).encode())
        before = read_settings(folder)
        for name, value in json.loads(json.dumps(settings)).items():
            if before.get(name) != value:
                raise InvalidInput(
                    f"{folder.name!r} was begun with {name} = {before.get(name)}, not {value}: "
                    "give it that, or another name"
                )
        yield Begun(before["identity"], before["begun"])


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
    path = folder / "settings.json"
    try:
        settings = json.loads(path.read_bytes())
        if not re.fullmatch("[0-9a-f]{32}", settings["identity"]):
            raise ValueError("its identity is not 32 hexadecimal digits")
        if not math.isfinite(settings["begun"]):
            raise ValueError("its time is not finite")
    except FileNotFoundError:
        raise InvalidInput(f"no run in {str(folder)!r}") from None
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise InvalidInput(f"damaged settings {str(path)!r}: {error}") from None
    return dict(settings)


def stored_task(facts: Any) -> Task:
    """The task that a run was begun on, from the facts in its settings alone: asking
    gymnasium for it could import what the file names. Raises TypeError, ValueError."""
    task = Task(**facts)
    kinds = {"id": str, "solved_reward": float, "worst_score": float}
    for name, value in asdict(task).items():
        if type(value) is not kinds.get(name, int):
            raise TypeError(f"task {name} is {value!r}")
    if ".." in task.id:
        raise ValueError(f"task id {task.id!r}")
    if min(task.state_size, task.n_actions, task.step_limit) < 1:
        raise ValueError("the task's sizes are not positive")
    return task
