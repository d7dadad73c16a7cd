"""The folder of an experiment.

settings.json     experiment, task, seed and kinds of agents
runs.jsonl        names of the NES runs that it rests on, as they end
results.jsonl     agents, as they end: digest of what was asked, and the result
transitions-*     (behaviour) what an agent met, one file an agent
findings.json     size, versions, command, and the summary of what was found
data.csv          all values; NAME.svg: the pictures
"""

import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

from bilevel.decode import decode, decode_file
from bilevel.version import __version__
from cluster.experiments.sizes import Size
from cluster.experiments.table import Value
from cluster.storage.run_folder import SETTINGS_FILE, Settings, read_settings

#: The kind of run in the settings.
KIND = "experiment"

#: Name of the report among the experiments.
REPORT = "report"

RUNS_FILE, FINDINGS_FILE, DATA_FILE = "runs.jsonl", "findings.json", "data.csv"
REPORT_FILE = "report.html"
#: Trained agents, as they end.
RESULTS_FILE = "results.jsonl"

#: Packages that results may depend on.
_PACKAGES = ("numpy", "numba", "scipy", "torch", "gymnasium", "ray", "mlflow", "matplotlib")


@dataclass(frozen=True, kw_only=True)
class ExperimentSettings(Settings):
    """The settings of an experiment, or of a report."""

    experiment: str
    kinds: dict[str, dict[str, Any]]  # hyperparameters by the agent's name

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the settings of the experiment in a folder. Raises InvalidInput."""
        return decode(cls, read_settings(folder), f"{str(folder)!r} holds no experiment")


@dataclass(frozen=True)
class StoredFindings:
    """`findings.json`."""

    experiment: str
    size: Size
    runs: dict[str, int]  # NES runs that it rests on, by condition
    pictures: tuple[str, ...]  # file names
    summary: tuple[dict[str, Value], ...]
    notes: tuple[str, ...]
    versions: dict[str, str]
    command: str  # by which it was found
    commit: str = ""  # of the source by which it was found, if known

    @classmethod
    def read(cls, folder: Path) -> "StoredFindings | None":
        """Read the findings in a folder; None if there are none yet. Raises InvalidInput."""
        path = folder / FINDINGS_FILE
        return decode_file(cls, path) if path.exists() else None


def folder_name(prefix: str, experiment: str, agents: tuple[str, ...] | None, seed: int) -> str:
    """Name of an experiment's folder; `agents` are those that were asked for."""
    asked = "" if agents is None else "-" + "-".join(agents)
    return f"{prefix}{experiment}{asked}-seed{seed}"


def documents(folder: Path) -> list[Path]:
    """Files of an experiment's folder that MLflow shows."""
    names = {SETTINGS_FILE, FINDINGS_FILE, DATA_FILE, REPORT_FILE, RUNS_FILE, RESULTS_FILE}
    return sorted(path for path in folder.glob("*") if path.name in names or path.suffix == ".svg")


def versions() -> dict[str, str]:
    """Versions of what results rest on."""
    found = {"bilevel": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "-"
    return found
