"""The folder of an evaluation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from bilevel.decode import decode
from cluster.storage.run_folder import Settings, read_settings

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
