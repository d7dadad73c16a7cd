"""Summary of a study's journal: incumbent, leaders, costs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from cluster.bohb.search.validation import Validation
from cluster.bohb.study.brackets import Rung, core_seconds_to_run
from cluster.bohb.study.journal import ConfigId, Journal, Origin, ResultLine


@dataclass(frozen=True)
class StudySummary:
    """Summary of a journal, for the brackets in `rungs`. It follows the journal as that grows."""

    journal: Journal
    rungs: Sequence[Rung] = ()
    validation: Validation | None = None

    @classmethod
    def of(cls, journal: Journal, rungs: Sequence[Rung] = ()) -> Self:
        """Return the summary with the validation on disk. Raises InvalidInput if it is damaged."""
        return cls(journal, rungs, Validation.load(journal.folder))

    @property
    def incumbent(self) -> ResultLine | None:
        """The winner of the validation, or else the leader."""
        return self.leader if self.validation is None else self.validation.finalists[0]

    @property
    def finalists(self) -> tuple[ResultLine, ...]:
        """Results of the validation, best first; empty without one."""
        return () if self.validation is None else self.validation.finalists

    @property
    def leader(self) -> ResultLine | None:
        """The best result at the largest budget that has results (hpbandster's incumbent)."""
        changes = self.leaders()
        return changes[-1][1] if changes else None

    def leaders(self) -> list[tuple[int, ResultLine]]:
        """Return each new leader with its number among the results, from 1."""
        changes: list[tuple[int, ResultLine]] = []
        for number, line in enumerate(self.journal.results, start=1):
            if line.loss is not None and (not changes or _key(line) < _key(changes[-1][1])):
                changes.append((number, line))
        return changes

    @property
    def ranked(self) -> list[ConfigId]:
        """Configurations with results, by their last budget and then by objective, best first."""
        last = {line.id: line for line in self.journal.successes}
        return sorted(last, key=lambda config_id: _key(last[config_id]))

    @property
    def model_based(self) -> int:
        """Number of configurations that the model proposed."""
        return sum(line.origin is Origin.MODEL for line in self.journal.configs)

    def points(self) -> list[tuple[int, ResultLine]]:
        """Return all successes with the core seconds that the search had spent, by budgets."""
        reached: dict[ConfigId, int] = {}
        points = []
        for line in self.journal.results:
            reached[line.id] = line.budget
            if line.loss is not None:
                points.append((sum(reached.values()), line))
        return points

    def core_seconds_left(self) -> int:
        """Return the core seconds until all brackets are complete, by budgets."""
        return max(core_seconds_to_run(self.rungs) - sum(self.journal.reached.values()), 0)


def _key(line: ResultLine) -> tuple[int, float]:
    """Return the sort key of a success: a larger budget first, then a lower objective."""
    return -line.budget, line.objective
