"""A row of the table: a fault, how often it was injected, and its effects."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.faults.outcome import Outcome

if TYPE_CHECKING:
    from tests.faults.stage import StudyOnStage


@dataclass(frozen=True)
class Row:
    """Effects of a fault, compared with an undisturbed study."""

    fault: str
    injected: int
    results: int
    lost: int
    duplicated: int
    identical: bool  # journal (less times), checkpoints (less times), best SE file
    mlflow: list[str]  # differences between MLflow and the disk
    exit_code: int

    @classmethod
    def of(
        cls, fault: str, injected: int, code: int, whole: Outcome, study: "StudyOnStage"
    ) -> "Row":
        """The row of a finished study."""
        return cls.compare(fault, injected, code, whole, study.outcome(), study.disagreements())

    @classmethod
    def compare(
        cls,
        fault: str,
        injected: int,
        code: int,
        whole: Outcome,
        outcome: Outcome,
        wrong: list[str],
    ) -> "Row":
        """The row of a given outcome."""
        lost, twice = whole.lost(outcome), outcome.duplicated
        same = outcome == whole
        return cls(fault, injected, len(outcome.results), lost, twice, same, wrong, code)
