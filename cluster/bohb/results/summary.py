"""Summary of a study's journal: incumbent, costs, bracket table."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

from cluster.bohb.search.validation import Validation
from cluster.bohb.study.brackets import Rung, core_seconds_to_run
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import ConfigId, Configuration, Journal, Origin, ResultLine


@dataclass(frozen=True)
class ResultPoint:
    """A result in the plot of objective against cost."""

    spent: int  # core seconds of the whole search up to the result, by budgets
    budget: int
    objective: float
    origin: Origin
    id: ConfigId


@dataclass(frozen=True)
class ValidatedPoint:
    """A finalist's objective over new seeds in the same plot."""

    searched: ResultPoint  # its last result in the search
    spent: int  # core seconds of search and validation
    objective: float


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
        return self.leader if self.validation is None else self.validation.winner

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

    def configuration(self, config_id: ConfigId) -> Configuration:
        """Return the configuration with that id."""
        return self.journal.proposals[config_id].configuration

    def result_of(self, config_id: ConfigId) -> ResultLine:
        """Return the last success of a configuration."""
        return next(line for line in reversed(self.journal.successes) if line.id == config_id)

    def points(self) -> list[ResultPoint]:
        """Return all successes with the core seconds that the search had spent."""
        proposals = self.journal.proposals
        reached: dict[ConfigId, int] = {}
        spent = 0
        points = []
        for line in self.journal.results:
            spent += line.budget - reached.get(line.id, 0)
            reached[line.id] = line.budget
            if line.loss is not None:
                origin = proposals[line.id].origin
                points.append(ResultPoint(spent, line.budget, line.loss, origin, line.id))
        return points

    def validated_points(self) -> list[ValidatedPoint]:
        """Return the finalists, the winner first; empty without a validation."""
        if self.validation is None:
            return []
        successes = [line.loss is not None for line in self.journal.results]
        before = self.points()[: sum(successes[: self.validation.results])]
        last = {point.id: point for point in before}
        spent = before[-1].spent + sum(line.budget for line in self.finalists)
        return [ValidatedPoint(last[line.id], spent, line.objective) for line in self.finalists]

    def core_seconds_left(self) -> int:
        """Return the core seconds until all brackets are complete, by budgets."""
        reached = {line.id: line.budget for line in self.journal.results}
        return max(core_seconds_to_run(self.rungs) - sum(reached.values()), 0)

    def validation_table(self) -> str:
        """Return the finalists' objectives in search and validation, in Markdown; empty without a
        validation."""
        rows = []
        for line in self.finalists:
            before = self.result_of(line.id)
            objectives = f"{line.loss:.1f}", f"{before.loss:.1f} ({before.budget} core seconds)"
            seeds = line.info["runs"], line.info["confirmed"]
            rows.append((configuration_name(line.id), line.budget, *seeds, *objectives))
        head = "configuration", "core seconds", "runs", "SEs", "objective", "in the search"
        return _markdown(head, rows) if rows else ""

    def bracket_table(self) -> str:
        """Return the results by bracket and budget, in Markdown."""
        rows = []
        for rung in self.rungs:
            key = rung.bracket, rung.budget
            lines = [line for line in self.journal.results if (line.id[0], line.budget) == key]
            losses = [line.loss for line in lines if line.loss is not None]
            best = f"{min(losses):.1f}" if losses else ""
            if lines:
                failed = len(lines) - len(losses)
                rows.append((*key, rung.configurations, len(lines), best, failed))
        head = "bracket", "core seconds", "configurations", "results", "best objective", "failed"
        return _markdown(head, rows)


def _key(line: ResultLine) -> tuple[int, float]:
    """Return the sort key of a success: a larger budget first, then a lower objective."""
    return -line.budget, line.objective


def _markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(map(str, cells))} |\n" for cells in lines)
