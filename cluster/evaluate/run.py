"""The folder of an evaluation (`bilevel evaluate`), and its MLflow run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from bilevel.decode import decode
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import Lifetime, Settings, finals, read_settings
from cluster.tracking import Document, Point, Progress, RunView

#: The kind of run in the settings.
KIND = "evaluate"

RESULTS_FILE, REPORT_FILE, PICTURE_FILE = "results.jsonl", "report.json", "returns.png"


@dataclass(frozen=True, kw_only=True)
class EvaluationSettings(Settings):
    """The settings of an evaluation."""

    vary: str
    sources: dict[str, str]  # label: digest of the SE, or "real"
    kinds: dict[str, dict[str, Any]]  # hyperparameters by the agent's name

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the settings of the evaluation in a folder. Raises InvalidInput."""
        return decode(cls, read_settings(folder), f"{str(folder)!r} holds no evaluation")


class EvaluationViews:
    """The MLflow run of an evaluation; `live` while this process works on it.

    Raises InvalidInput if its settings are damaged.
    """

    def __init__(self, folder: Path, live: bool = False) -> None:
        self.folder, self.live = folder, live
        self.settings = EvaluationSettings.read(folder)
        self.task_id = self.settings.task.id

    def keys(self) -> list[str]:
        """Return the evaluation's identity."""
        return [self.settings.uuid]

    def view(self, key: str) -> RunView:
        """Read the run from disk. Raises InvalidInput."""
        settings, task = self.settings, self.task_id
        lifetime = Lifetime.of(self.folder, settings.began, self.live)
        files = [self.folder / name for name in (REPORT_FILE, PICTURE_FILE, RESULTS_FILE)]
        return RunView(
            key,
            self.folder.name,
            lifetime,
            {"agents": settings.kinds, "vary": settings.vary, "seed": settings.seed, "task": task},
            {"bilevel.kind": KIND},
            tuple(Point.of_final(end) for end in finals(self.folder)),
            tuple(Document.of_file(path) for path in files if lifetime.over and path.exists()),
            identity=settings,
            description=f"Fresh agents on {', '.join(settings.sources)}, tested on {task}.",
        )


def evaluation_progress(folder: Path, agents: int) -> Progress:
    """Return the number of trained agents, of `agents` for each source and kind. Raises
    InvalidInput."""
    settings = EvaluationSettings.read(folder)
    total = agents * len(settings.sources) * len(settings.kinds)
    trained = len(JsonlLog(folder / RESULTS_FILE).values)
    return Progress(f"{trained}/{max(total, trained)} agents")
