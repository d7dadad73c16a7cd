"""The folder of an evaluation (`bilevel evaluate`), and its MLflow run."""

from dataclasses import dataclass
from typing import Any

from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import Settings
from cluster.tracking import Document, RunView, Views

RESULTS_FILE, REPORT_FILE, PICTURE_FILE = "results.jsonl", "report.json", "returns.png"


@dataclass(frozen=True, kw_only=True)
class EvaluationSettings(Settings):
    """The settings of an evaluation."""

    vary: str
    sources: dict[str, str]  # label: digest of the SE, or "real"
    kinds: dict[str, dict[str, dict[str, Any]]]  # hyperparameters by source and agent

    noun = "evaluation"


class EvaluationViews(Views):
    """The MLflow run of an evaluation."""

    kind = "evaluate"

    def view(self, key: str) -> RunView:
        """Read the run from disk. Raises InvalidInput."""
        settings, task = EvaluationSettings.read(self.folder), self.task_id
        files = [self.folder / name for name in (REPORT_FILE, PICTURE_FILE, RESULTS_FILE)]
        ended = self.lifetime.ended is not None
        return self.own_run(
            {"agents": settings.kinds, "vary": settings.vary, "seed": settings.seed, "task": task},
            documents=[Document.of_file(path) for path in files if ended and path.exists()],
            description=f"Fresh agents on {', '.join(settings.sources)}, tested on {task}.",
        )

    def progress(self) -> tuple[str, str]:
        """Return the number of trained agents, of `target` for each source and kind."""
        settings = EvaluationSettings.read(self.folder)
        total = self.lifetime.target * sum(map(len, settings.kinds.values()))
        trained = len(JsonlLog(self.folder / RESULTS_FILE).values)
        return f"{trained}/{max(total, trained)} agents", ""
