"""MLflow view of an evaluation (`bilevel evaluate`)."""

from dataclasses import dataclass
from pathlib import Path

from cluster.evaluate import run
from cluster.evaluate.run import EvaluationSettings
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
        """View an evaluation that no process works on. Raises InvalidInput if it is damaged."""
        EvaluationSettings.read(folder)
        return cls(folder, RunIdentity.read(folder), False)

    @property
    def task_id(self) -> str:
        """The task that the agents are tested on."""
        return EvaluationSettings.read(self.folder).task.id

    def keys(self) -> list[str]:
        """Return the evaluation's identity."""
        return [self.identity.uuid]

    def view(self, key: str) -> RunView:
        """Read the run from disk. Raises InvalidInput."""
        settings, ends = EvaluationSettings.read(self.folder), finals(self.folder)
        lifetime = Lifetime.of(self.folder, self.identity.began, self.live)
        sources, task = ", ".join(settings.sources), settings.task.id
        note = f"{lifetime.target} fresh agents of each kind on {sources}, tested on {task}."
        files = [
            self.folder / name for name in (run.REPORT_FILE, run.PICTURE_FILE, run.RESULTS_FILE)
        ]
        return RunView(
            key,
            self.folder.name,
            lifetime,
            {"agents": settings.kinds, "vary": settings.vary, "seed": settings.seed, "task": task},
            {"bilevel.kind": run.KIND},
            tuple(Point.of_final(end) for end in ends),
            tuple(Document.of_file(path) for path in files if lifetime.over and path.exists()),
            identity=self.identity,
            description=note,
        )


def evaluation_progress(folder: Path, agents: int) -> Progress:
    """Return the number of trained agents, of `agents` for each source and kind. Raises
    InvalidInput."""
    settings = EvaluationSettings.read(folder)
    total = agents * len(settings.sources) * len(settings.kinds)
    trained = len(JsonlLog(folder / run.RESULTS_FILE).values)
    return Progress(f"{trained}/{max(total, trained)} agents")
