"""Views: plain values, built from the files on disk, that state what MLflow should show of a run.

After each change a new view is built, and `Tracker.show` writes what MLflow lacks of it. So it does
not matter which earlier writes reached MLflow, or when.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from bilevel.errors import InvalidInput
from bilevel.nes import GenerationRecord
from cluster.storage.run_folder import Final, Lifetime, RunIdentity


@dataclass(frozen=True)
class Point:
    """Metrics of one event, which are logged in one transaction."""

    values: Mapping[str, float]
    step: int
    time: float  # of the event, unix seconds, so that a repeated write changes nothing
    #: Whether another point of this step may follow later.
    repeated: bool = False

    @property
    def milliseconds(self) -> int:
        """MLflow's time of the event."""
        return int(self.time * 1000)

    @property
    def mark(self) -> tuple[str, int, int]:
        """What identifies the point in MLflow: the metric, the step, and, where others of this step
        may follow, the time (else 0)."""
        return next(iter(self.values)), self.step, self.milliseconds if self.repeated else 0

    @classmethod
    def of(cls, record: GenerationRecord, before: int = 0, **more: float) -> "Point":
        """The point of a generation, with `more` metrics; its step is the generation, after those
        of earlier runs."""
        values = asdict(record) | more
        time, step = values.pop("finished"), values.pop("generation")
        return cls(values, before + step, time)

    @classmethod
    def of_final(cls, final: Final) -> "Point":
        """The point of the final scores, of fresh agents on the best SE."""
        return cls(final.metrics, final.step, final.time, repeated=True)


@dataclass(frozen=True)
class Progress:
    """Progress of a run, in words."""

    done: str
    best: str = ""  # best objective of a study, or score of an NES run, so far


@dataclass(frozen=True)
class Document:
    """An artifact of the run; `content` is called only if MLflow lacks this version."""

    path: str  # within the run's artifacts
    version: str
    content: Callable[[], bytes]

    @classmethod
    def of_file(cls, path: Path, folder: str = "") -> "Document":
        """A small, complete file on disk. Raises InvalidInput if it cannot be read."""
        try:
            content = path.read_bytes()
        except OSError as error:
            raise InvalidInput(f"cannot read {str(path)!r}: {error.strerror}") from None
        return cls(folder + path.name, hashlib.sha256(content).hexdigest(), lambda: content)

    @classmethod
    def of_text(cls, path: str, text: str) -> "Document":
        """A text file at `path`."""
        content = text.encode()
        return cls(path, hashlib.sha256(content).hexdigest(), lambda: content)


class DocumentFailed(Exception):
    """A document cannot be made; the message tells which and why."""


@dataclass(frozen=True)
class RegisteredSE:
    """An SE for the model registry: its file's content, task, time and tags."""

    content: bytes
    task_id: str
    time: float  # unix time, seconds; when the SE was saved
    tags: Mapping[str, str]

    @property
    def version(self) -> str:
        """Checksum of the file (SHA-256)."""
        return hashlib.sha256(self.content).hexdigest()


@dataclass(frozen=True)
class RunView:
    """A run as MLflow should show it. `key` identifies the run, whatever its name."""

    key: str
    name: str
    lifetime: Lifetime
    params: Mapping[str, Any]
    tags: Mapping[str, str]
    points: tuple[Point, ...] = ()
    documents: tuple[Document, ...] = ()
    parent: str | None = None  # key of the parent run
    #: A run whose edition does not begin with the one shown is replaced: its times differ.
    edition: str | None = None
    model: RegisteredSE | None = field(default=None)
    identity: RunIdentity | None = None
    description: str = ""  # Markdown

    @property
    def note(self) -> str:
        """The description, the command, and whether code has changed; that of a stopped run says
        first that it can go on."""
        paragraphs = [self.description]
        if self.lifetime.status == "KILLED":
            stopped = "**Stopped, and nothing is lost:** the same command resumes it."
            paragraphs.insert(0, stopped)
        if self.identity is not None and self.identity.author is not None:
            paragraphs.append(f"Begun by `{self.identity.author.command}`")
        if self.identity is not None and self.identity.mixture:
            paragraphs.append(self.identity.mixture)
        return "\n\n".join(paragraphs)


class Views(Protocol):
    """The MLflow runs of one folder."""

    @property
    def task_id(self) -> str:
        """The task, which names the experiment."""

    def keys(self) -> list[str]:
        """Keys of the runs, parents first."""

    def view(self, key: str) -> RunView:
        """The run with that key, from the current files. Raises InvalidInput."""
