"""MLflow view of an experiment (`bilevel experiment`)."""

from dataclasses import dataclass
from pathlib import Path

from cluster.experiments.registry import explanation_of
from cluster.experiments.run import (
    KIND,
    REPORT,
    RESULTS_FILE,
    RUNS_FILE,
    ExperimentSettings,
    StoredFindings,
    documents,
)
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import Lifetime, RunIdentity, finals
from cluster.tracking import Document, Point, Progress, RunView


@dataclass(frozen=True)
class ExperimentViews:
    """The MLflow run of an experiment; `live` while a process works on it."""

    folder: Path
    identity: RunIdentity
    live: bool

    @classmethod
    def of(cls, folder: Path) -> "ExperimentViews":
        """View an experiment that no process works on. Raises InvalidInput if it is damaged."""
        ExperimentSettings.read(folder)
        return cls(folder, RunIdentity.read(folder), False)

    @property
    def task_id(self) -> str:
        """The experiment's task."""
        return ExperimentSettings.read(self.folder).task.id

    def keys(self) -> list[str]:
        """Return the experiment's identity."""
        return [self.identity.uuid]

    def view(self, key: str) -> RunView:
        """Read the run from disk. Raises InvalidInput."""
        settings, ends = ExperimentSettings.read(self.folder), finals(self.folder)
        lifetime = Lifetime.of(self.folder, self.identity.began, self.live)
        found = StoredFindings.read(self.folder)
        return RunView(
            key,
            self.folder.name,
            lifetime,
            {
                "experiment": settings.experiment,
                "task": settings.task.id,
                "seed": settings.seed,
                "agents": settings.kinds,
            },
            # The size is a tag because it may change, and MLflow's parameters cannot.
            {"bilevel.kind": KIND, **({"bilevel.size": found.size.name} if found else {})},
            tuple(Point.of_final(end) for end in ends),
            tuple(Document.of_file(path) for path in documents(self.folder) if lifetime.over),
            identity=self.identity,
            description=explanation_of(settings.experiment),
        )


def experiment_progress(folder: Path, runs: int) -> Progress:
    """Return the number of finished NES runs, of `runs`, and of trained agents. Raises
    InvalidInput."""
    if ExperimentSettings.read(folder).experiment == REPORT:
        return Progress("1 page")
    finished = len(JsonlLog(folder / RUNS_FILE).values)
    agents = len(JsonlLog(folder / RESULTS_FILE).values)
    trained = f", {agents} agents" if agents else ""
    return Progress(f"{min(finished, runs)}/{runs} SEs{trained}")
