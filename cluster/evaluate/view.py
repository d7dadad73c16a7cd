"""An evaluation of many agents (`bilevel evaluate`) as MLflow shows it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from bilevel.decode import decode
from cluster.storage.run_folder import Begun, Settings, Standing, finals, read_settings
from cluster.tracking import Document, Point, RunView

#: The kind of run that `settings.json` tells.
KIND = "evaluate"

RESULTS_FILE, REPORT_FILE, PICTURE_FILE = "results.jsonl", "report.json", "returns.png"


@dataclass(frozen=True, kw_only=True)
class EvaluationSettings(Settings):
    """What `settings.json` holds of an evaluation."""

    vary: str
    sources: dict[str, str]  # label: digest of the SE, or "real"
    kinds: dict[str, dict[str, Any]]  # hyperparameters by the agent's name

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Of the evaluation in a folder. Raises InvalidInput."""
        return decode(cls, read_settings(folder), f"{str(folder)!r} holds no evaluation")


@dataclass(frozen=True)
class EvaluationViews:
    """The one run that an evaluation is shown as."""

    folder: Path
    begun: Begun
    live: bool

    @classmethod
    def of(cls, folder: Path) -> "EvaluationViews":
        """Of an evaluation that nobody works on. Raises InvalidInput."""
        EvaluationSettings.read(folder)
        return cls(folder, Begun.read(folder), False)

    @property
    def task_id(self) -> str:
        """The task that the agents are tested on."""
        return EvaluationSettings.read(self.folder).task.id

    def keys(self) -> list[str]:
        """The evaluation's identity."""
        return [self.begun.identity]

    def view(self, key: str) -> RunView:
        """The run as it is on disk. Raises InvalidInput."""
        settings, ends = EvaluationSettings.read(self.folder), finals(self.folder)
        standing = Standing.load(self.folder) or Standing("KILLED", self.begun.time, 0)
        over = not (self.live and standing.status == "RUNNING")
        sources, task = ", ".join(settings.sources), settings.task.id
        note = f"{standing.target} fresh agents of each kind on {sources}, tested on {task}."
        files = [self.folder / name for name in (REPORT_FILE, PICTURE_FILE, RESULTS_FILE)]
        return RunView(
            key,
            self.folder.name,
            standing.ended_as if over else "RUNNING",
            self.begun.time,
            standing.since if over else None,
            {"agents": settings.kinds, "vary": settings.vary, "seed": settings.seed, "task": task},
            {"bilevel.kind": KIND},
            tuple(Point.of_final(end) for end in ends),
            tuple(Document.of_file(path) for path in files if over and path.exists()),
            author=self.begun.by,
            description=note,
        )
