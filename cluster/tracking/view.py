"""Views: the content that MLflow should show of a run, as plain values built from files on disk.

`Tracker.show` compares a view with MLflow and writes the difference, so it does not matter which
earlier writes reached MLflow.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from bilevel.errors import InvalidInput
from bilevel.nes import GenerationRecord
from cluster.storage.run_folder import Final, Lifetime, RunIdentity


@dataclass(frozen=True)
class Point:
    """Metrics of one event."""

    values: Mapping[str, float]
    step: int
    time: float  # of the event, unix seconds; not of the write, which may be repeated

    @property
    def milliseconds(self) -> int:
        """Time of the event as MLflow stores it."""
        return int(self.time * 1000)

    @property
    def key(self) -> tuple[str, int, int]:
        """Name of the first metric, step, and time in milliseconds."""
        return next(iter(self.values)), self.step, self.milliseconds

    @classmethod
    def of(cls, record: GenerationRecord, before: int = 0, **more: float) -> "Point":
        """Return the point of a generation with additional metrics. The step also counts `before`,
        the generations of earlier NES runs."""
        values = asdict(record) | more
        time, step = values.pop("finished"), values.pop("generation")
        return cls(values, before + step, time)

    @classmethod
    def of_final(cls, final: Final) -> "Point":
        """Return the point of the scores of fresh agents on the best SE."""
        return cls(final.metrics, final.step, final.time)


@dataclass(frozen=True)
class Progress:
    """Progress of a run, formatted for `bilevel runs`."""

    done: str
    best: str = ""  # best objective of a study, or best score of an NES run, so far


@dataclass(frozen=True)
class Document:
    """Artifact of a run. `content` is called only if MLflow lacks this version."""

    path: str  # relative to the run's artifacts
    version: str
    content: Callable[[], bytes]

    @classmethod
    def of_file(cls, path: Path, folder: str = "") -> "Document":
        """Return a document with the content of a small file. Raises InvalidInput if it cannot be
        read."""
        try:
            return cls.of(folder + path.name, path.read_bytes())
        except OSError as error:
            raise InvalidInput(f"cannot read {str(path)!r}: {error.strerror}") from None

    @classmethod
    def of(cls, path: str, content: bytes) -> "Document":
        """Return a document with that content."""
        return cls(path, hashlib.sha256(content).hexdigest(), lambda: content)

    @classmethod
    def of_text(cls, path: str, text: str) -> "Document":
        """Return a document with that text."""
        return cls.of(path, text.encode())


@dataclass(frozen=True)
class RegisteredSE:
    """SE for the model registry."""

    file: Document
    task_id: str
    time: float  # unix time in seconds when the SE was saved
    tags: Mapping[str, str]


@dataclass(frozen=True)
class RunView:
    """Complete content of a run in MLflow. `key` identifies the run and never changes."""

    key: str
    name: str
    lifetime: Lifetime
    params: Mapping[str, Any]
    tags: Mapping[str, str]
    points: tuple[Point, ...] = ()
    documents: tuple[Document, ...] = ()
    parent: str | None = None  # key of the parent run
    model: RegisteredSE | None = None
    identity: RunIdentity | None = None
    description: str = ""  # Markdown

    @property
    def note(self) -> str:
        """Text of the run's page: description, command, and whether the command resumes the
        run."""
        paragraphs = [self.description]
        if self.lifetime.status == "KILLED":
            paragraphs.insert(0, "**Stopped:** run the same command again to resume.")
        if self.identity is not None and self.identity.author is not None:
            paragraphs.append(f"Command: `{self.identity.author.command}`")
        return "\n\n".join(paragraphs)


class Views(Protocol):
    """The MLflow runs of one run folder."""

    @property
    def task_id(self) -> str:
        """Task of the run and name of the MLflow experiment."""

    def keys(self) -> list[str]:
        """Keys of the MLflow runs, parents first."""

    def view(self, key: str) -> RunView:
        """View of the run with that key, from the current files. Raises InvalidInput."""
