"""Views: the content that MLflow should show of a run, as plain values built from files on disk.

`Tracker.show` compares a view with MLflow and writes the difference, so it does not matter which
earlier writes reached MLflow.
"""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from bilevel.errors import InvalidInput
from bilevel.nes import GenerationRecord
from cluster.storage.run_folder import Lifetime, RunIdentity, finals, read_settings, stored_task


@dataclass(frozen=True)
class Point:
    """Metrics of one event."""

    values: Mapping[str, float]
    step: int
    time: float  # of the event, unix seconds; not of the write, which may be repeated

    @property
    def key(self) -> tuple[str, int, int]:
        """Name of the last metric, which is written after the others, step, and time in
        milliseconds."""
        return [*self.values][-1], self.step, int(self.time * 1000)

    @classmethod
    def of(cls, record: GenerationRecord, before: int = 0, **more: float) -> "Point":
        """Return the point of a generation with additional metrics. The step also counts `before`,
        the generations of earlier NES runs."""
        values = asdict(record) | more
        time, step = values.pop("finished"), values.pop("generation")
        return cls(values, before + step, time)


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
    def of(cls, path: str, content: str | bytes) -> "Document":
        """Return a document with that content."""
        data = content.encode() if isinstance(content, str) else content
        return cls(path, hashlib.sha256(data).hexdigest(), lambda: data)


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


class Views(ABC):
    """The MLflow runs of a run folder; `live` while this process works on it.

    Raises InvalidInput if its settings are damaged.
    """

    #: The kind of run in the settings.
    kind: ClassVar[str]

    def __init__(self, folder: Path, live: bool = False) -> None:
        self.folder, self.live = folder, live
        self.identity = RunIdentity.read(folder)
        self.task_id = stored_task(read_settings(folder).get("task")).id

    @property
    def lifetime(self) -> Lifetime:
        """Start, end, status and target of the run. Raises InvalidInput."""
        return Lifetime.of(self.folder, self.identity.began, self.live)

    def keys(self) -> list[str]:
        """Keys of the MLflow runs, the folder's own run first. Raises InvalidInput."""
        return [self.identity.uuid]

    @abstractmethod
    def view(self, key: str) -> RunView:
        """View of the run with that key, from the current files. Raises InvalidInput."""

    @abstractmethod
    def progress(self) -> tuple[str, str]:
        """Progress towards the target, and the best objective or score so far, as text. Custom
        agents need not be installed. Raises InvalidInput."""

    def own_run(
        self,
        params: Mapping[str, Any],
        points: Iterable[Point] = (),
        tags: Mapping[str, str] = {},
        **content: Any,
    ) -> RunView:
        """Return the view of the folder's own run: its ends follow `points`. `content` are other
        fields of the view."""
        ends = (Point(end.metrics, end.step, end.time) for end in finals(self.folder))
        return RunView(
            self.identity.uuid,
            self.folder.name,
            self.lifetime,
            params,
            {"bilevel.kind": self.kind, **tags},
            (*points, *ends),
            identity=self.identity,
            **content,
        )
