"""What MLflow should show of a run: a plain value, made from what is on disk.

A view is made anew whenever something has changed; `Tracker.show` brings MLflow from
whatever it shows to the view. So it does not matter what reached MLflow, or when.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from bilevel.errors import InvalidInput
from bilevel.nes import GenerationRecord
from cluster.storage.run_folder import Final


@dataclass(frozen=True)
class Point:
    """Metrics that belong together: they are logged in one transaction."""

    values: Mapping[str, float]
    step: int
    time: float  # unix time, seconds; of the event, so that a repeated write changes nothing

    @property
    def mark(self) -> tuple[str, int]:
        """The metric and step by which the point is found in MLflow."""
        return next(iter(self.values)), self.step

    @classmethod
    def of(cls, record: GenerationRecord) -> "Point":
        """A generation, at its own step."""
        values = asdict(record)
        time, step = values.pop("finished"), values.pop("generation")
        return cls(values, step, time)

    @classmethod
    def of_final(cls, final: Final) -> "Point":
        """The scores of fresh agents on the best SE."""
        return cls(final.metrics, final.step, final.time)


@dataclass(frozen=True)
class Document:
    """A file of the run; `content` is asked for only if another version is there."""

    path: str  # within the run's artifacts
    version: str
    content: Callable[[], bytes]

    @classmethod
    def of_file(cls, path: Path, folder: str = "") -> "Document":
        """A file on disk, which is complete and small. Raises InvalidInput if it is gone."""
        try:
            content = path.read_bytes()
        except OSError as error:
            raise InvalidInput(f"cannot read {str(path)!r}: {error.strerror}") from None
        return cls(folder + path.name, hashlib.sha256(content).hexdigest(), lambda: content)

    @classmethod
    def of_text(cls, path: str, text: str) -> "Document":
        """A text."""
        content = text.encode()
        return cls(path, hashlib.sha256(content).hexdigest(), lambda: content)


@dataclass(frozen=True)
class RegisteredSE:
    """An SE for the model registry: its file, the task, and what to say of it."""

    path: Path
    task_id: str
    time: float  # unix time, seconds; when it was handed over
    tags: Mapping[str, str]

    @property
    def version(self) -> str:
        """Tells one file from another."""
        return hashlib.sha256(self.path.read_bytes()).hexdigest()


@dataclass(frozen=True)
class RunView:
    """A run as MLflow should show it. `key` says which it is, whatever it is called."""

    key: str
    name: str
    status: str  # RUNNING, FINISHED, KILLED, FAILED
    started: float  # unix time, seconds
    ended: float | None  # None while it runs
    params: Mapping[str, Any]
    tags: Mapping[str, str]
    points: tuple[Point, ...] = ()
    documents: tuple[Document, ...] = ()
    parent: str | None = None  # key of the run it is shown under
    edition: str | None = None  # another one replaces the run: its points are of another course
    model: RegisteredSE | None = field(default=None)


class Views(Protocol):
    """The runs that a folder is shown as."""

    @property
    def task_id(self) -> str:
        """The task, whose experiment they belong to."""

    def keys(self) -> list[str]:
        """Their keys, parents first."""

    def view(self, key: str) -> RunView:
        """The run with that key, from what is on disk now. Raises InvalidInput."""
