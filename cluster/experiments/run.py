"""The folder of an experiment.

settings.json     experiment, task, seed and kinds of agents
runs.jsonl        names of its NES runs, appended when they finish
results.jsonl     results of agents, appended when they finish, each with the digest of its request
findings.json     size, versions, command and summary
data.csv          all values; NAME.svg: the pictures
"""

import platform
from dataclasses import dataclass
from importlib.metadata import version
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
RESULTS_FILE, REPORT_FILE = "results.jsonl", "report.html"

#: Packages that results may depend on.
_PACKAGES = ("numpy", "numba", "scipy", "torch", "gymnasium", "ray", "mlflow", "matplotlib")


@dataclass(frozen=True, kw_only=True)
class ExperimentSettings(Settings):
    """Settings of an experiment, or of a report."""

    experiment: str
    kinds: dict[str, dict[str, Any]]  # hyperparameters by the agent's name

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the settings in a folder. Raises InvalidInput."""
        return decode(cls, read_settings(folder), f"{str(folder)!r} holds no experiment")


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


def folder_name(prefix: str, experiment: str, agents: tuple[str, ...] | None, seed: int) -> str:
    """Return the name of an experiment's folder; `agents` are those that the user named."""
    named = "" if agents is None else "-" + "-".join(agents)
    return f"{prefix}{experiment}{named}-seed{seed}"


def documents(folder: Path) -> list[Path]:
    """Return the files of an experiment's folder that MLflow stores."""
    names = {SETTINGS_FILE, FINDINGS_FILE, DATA_FILE, REPORT_FILE, RUNS_FILE, RESULTS_FILE}
    return sorted(path for path in folder.glob("*") if path.name in names or path.suffix == ".svg")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that results may depend on."""
    packages = {package: version(package) for package in _PACKAGES}
    return {"bilevel": __version__, "python": platform.python_version(), **packages}
