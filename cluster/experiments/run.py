"""The folder of an experiment, and its MLflow run.

settings.json     experiment, task, seed and kinds of agents
runs.jsonl        names of its NES runs, appended when they finish
results.jsonl     results of agents, appended when they finish, each with the digest of its request
findings.json     size, versions, command and summary
data.csv          all values; NAME.svg: the pictures
report.html       the report, in a folder of its own
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bilevel.decode import decode_file
from bilevel.errors import InvalidInput
from bilevel.evaluation import EvaluationResult
from cluster.evaluate.report import Value
from cluster.experiments.experiment import Found
from cluster.experiments.figures import EXPERIMENTS
from cluster.experiments.sizes import Size
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import SETTINGS_FILE, Settings
from cluster.tracking import Document, RunView, Views

#: Name of the report among the experiments.
REPORT = "report"

RUNS_FILE, FINDINGS_FILE, DATA_FILE = "runs.jsonl", "findings.json", "data.csv"
RESULTS_FILE, REPORT_FILE = "results.jsonl", "report.html"

#: Files that MLflow stores, in addition to the pictures.
_STORED = {SETTINGS_FILE, FINDINGS_FILE, DATA_FILE, REPORT_FILE, RUNS_FILE, RESULTS_FILE}


@dataclass(frozen=True, kw_only=True)
class ExperimentSettings(Settings):
    """Settings of an experiment, or of a report."""

    experiment: str
    kinds: dict[str, dict[str, Any]]  # hyperparameters by the agent's name

    noun = "experiment"


@dataclass(frozen=True)
class StoredFindings:
    """Content of `findings.json`."""

    experiment: str
    size: Size
    runs: dict[str, int]  # NES runs by condition
    pictures: tuple[str, ...]  # file names
    summary: tuple[dict[str, Value], ...]
    notes: tuple[str, ...]
    versions: dict[str, str]
    command: str
    commit: str  # of the code, empty if unknown

    @classmethod
    def read(cls, folder: Path) -> "StoredFindings | None":
        """Read the findings in a folder; None if there are none yet. Raises InvalidInput."""
        path = folder / FINDINGS_FILE
        return decode_file(cls, path) if path.exists() else None


class AgentResults:
    """Durable results of an experiment's agents. Raises InvalidInput for a damaged file."""

    def __init__(self, folder: Path) -> None:
        self._log = JsonlLog(folder / RESULTS_FILE)
        self._folder = folder
        self.found: Found = dict(self._log.decoded(tuple[str, EvaluationResult]))

    def add(self, key: str, result: EvaluationResult) -> None:
        """Append a result. Raises StorageFailure."""
        self._log.append([key, asdict(result)])
        self.found[key] = result

    def adopt(self, keys: Iterable[str]) -> None:
        """Copy the results with these keys from other experiments of the task, except for damaged
        files."""
        missing = {*keys} - self.found.keys()
        if not missing:
            return
        for path in sorted(self._folder.parent.glob(f"experiment-*/{RESULTS_FILE}")):
            found: Found = {}
            with suppress(InvalidInput):
                found = dict(JsonlLog(path).decoded(tuple[str, EvaluationResult]))
            for key in sorted(missing & found.keys()):
                missing.remove(key)
                self.add(key, found[key])


class ExperimentViews(Views):
    """The MLflow run of an experiment."""

    kind = "experiment"

    def view(self, key: str) -> RunView:
        """Read the run from disk. Raises InvalidInput."""
        settings = ExperimentSettings.read(self.folder)
        found, ended = StoredFindings.read(self.folder), self.lifetime.ended is not None
        experiment = EXPERIMENTS.get(settings.experiment)  # None for the report
        files = [p for p in self.folder.glob("*") if p.name in _STORED or p.suffix == ".svg"]
        return self.own_run(
            {
                "experiment": settings.experiment,
                "task": self.task_id,
                "seed": settings.seed,
                "agents": settings.kinds,
            },
            # The size is a tag because it may change, and MLflow's parameters cannot.
            tags={"bilevel.size": found.size.name} if found else {},
            documents=[Document.of_file(path) for path in sorted(files) if ended],
            description=experiment.explanation if experiment else "",
        )

    def progress(self) -> tuple[str, str]:
        """Return the number of finished NES runs, of `target`, and of trained agents."""
        if ExperimentSettings.read(self.folder).experiment == REPORT:
            return "1 page", ""
        finished, runs = len(JsonlLog(self.folder / RUNS_FILE).values), self.lifetime.target
        agents = len(JsonlLog(self.folder / RESULTS_FILE).values)
        return f"{min(finished, runs)}/{runs} SEs, {agents} agents", ""
