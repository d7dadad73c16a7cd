"""An evaluation of many agents (`bilevel evaluate`) as MLflow shows it."""

from dataclasses import dataclass
from pathlib import Path

from cluster.evaluate.run import (
    KIND,
    PICTURE_FILE,
    REPORT_FILE,
    RESULTS_FILE,
    EvaluationSettings,
)
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import Lifetime, RunIdentity, finals
from cluster.tracking import Document, Point, Progress, RunView


@dataclass(frozen=True)
class EvaluationViews:
    """The MLflow run of an evaluation; `live` while a process works on it."""

    folder: Path
    identity: RunIdentity
    live: bool

    @classmethod
    def of(cls, folder: Path) -> "EvaluationViews":
        """View of an evaluation that no process works on. Raises InvalidInput if it is damaged."""
        EvaluationSettings.read(folder)
        return cls(folder, RunIdentity.read(folder), False)

    @property
    def task_id(self) -> str:
        """The task that the agents are tested on."""
        return EvaluationSettings.read(self.folder).task.id

    def keys(self) -> list[str]:
        """The evaluation's identity."""
        return [self.identity.uuid]

    def view(self, key: str) -> RunView:
        """The run as it is on disk. Raises InvalidInput."""
        settings, ends = EvaluationSettings.read(self.folder), finals(self.folder)
        lifetime = Lifetime.of(self.folder, self.identity.began, self.live)
        sources, task = ", ".join(settings.sources), settings.task.id
        note = f"{lifetime.target} fresh agents of each kind on {sources}, tested on {task}."
        files = [self.folder / name for name in (REPORT_FILE, PICTURE_FILE, RESULTS_FILE)]
        return RunView(
            key,
            self.folder.name,
            lifetime,
            {"agents": settings.kinds, "vary": settings.vary, "seed": settings.seed, "task": task},
            {"bilevel.kind": KIND},
            tuple(Point.of_final(end) for end in ends),
            tuple(Document.of_file(path) for path in files if lifetime.over and path.exists()),
            identity=self.identity,
            description=note,
        )


def evaluation_progress(folder: Path, agents: int) -> Progress:
    """Number of agents trained so far, of `agents` for each source and kind. Raises
    InvalidInput."""
    settings = EvaluationSettings.read(folder)
    total = agents * len(settings.sources) * len(settings.kinds)
    trained = len(JsonlLog(folder / RESULTS_FILE).values)
    return Progress(f"{trained}/{max(total, trained)} agents")
