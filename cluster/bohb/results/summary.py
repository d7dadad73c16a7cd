"""Summary of a study's journal so far: incumbent, costs, bracket table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from bilevel.errors import InvalidInput
from cluster.bohb.search.validation import VALIDATION_FILE, Validation
from cluster.bohb.study.brackets import Rung, core_seconds_to_run
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import ConfigId, Configuration, Journal, Origin, ResultLine


@dataclass(frozen=True)
class ResultPoint:
    """A result of the search, for the plot of objective against cost."""

    spent: int  # core seconds of the whole search when the result came, by budgets
    budget: int
    seconds: float  # since the first job began, pauses included
    objective: float
    origin: Origin
    id: ConfigId


@dataclass(frozen=True)
class ValidatedPoint:
    """A finalist's objective over new seeds, for the same plot."""

    searched: ResultPoint  # its last result in the search
    spent: int  # core seconds of the study when the validation was over
    objective: float


@dataclass(frozen=True)
class StudySummary:
    """Summary of a journal for the brackets in `rungs`, and of the study's validation; it follows
    the journal as that grows."""

    journal: Journal
    rungs: Sequence[Rung] = ()
    validation: Validation | None = None

    @classmethod
    def of(cls, journal: Journal, rungs: Sequence[Rung] = ()) -> Self:
        """With the study's validation as it is on disk. Raises InvalidInput if that is damaged, or
        of results that the journal does not have."""
        validation = Validation.load(journal.folder)
        if validation is not None and not validation.is_of(journal):
            raise InvalidInput(
                f"{VALIDATION_FILE} in {str(journal.folder)!r} is of other results than the "
                "journal beside it: take both from the same copy, or remove it to validate again"
            )
        return cls(journal, rungs, validation)

    @property
    def incumbent(self) -> ResultLine | None:
        """What is handed over: the winner of the validation, else the leader."""
        return self.leader if self.validation is None else self.validation.winner

    @property
    def finalists(self) -> tuple[ResultLine, ...]:
        """What they came to over new seeds, best first; empty without a validation."""
        return () if self.validation is None else self.validation.finalists

    @property
    def leader(self) -> ResultLine | None:
        """The best result at the largest budget that has results (hpbandster's incumbent)."""
        changes = self.leaders()
        return changes[-1][1] if changes else None

    def leaders(self) -> list[tuple[int, ResultLine]]:
        """Each change of the leader, with the number (from 1) of the result that caused it."""
        changes: list[tuple[int, ResultLine]] = []
        best: ResultLine | None = None
        for number, line in enumerate(self.journal.results, start=1):
            if line.loss is not None and (best is None or _better(line, best)):
                best = line
                changes.append((number, line))
        return changes

    @property
    def ranked(self) -> list[ConfigId]:
        """The configurations that have results, the best first. Those that went on to a larger
        budget come before those that did not."""
        last = {line.id: line for line in self.journal.successes}
        return sorted(last, key=lambda one: (-last[one].budget, last[one].objective))

    @property
    def model_based(self) -> int:
        """Number of configurations that the model proposed."""
        return sum(line.origin is Origin.MODEL for line in self.journal.configs)

    def configuration(self, config_id: ConfigId) -> Configuration:
        """The configuration with that id."""
        return self.journal.proposals[config_id].configuration

    def result_of(self, config_id: ConfigId) -> ResultLine:
        """The last result of that configuration that is no failure."""
        return next(line for line in reversed(self.journal.successes) if line.id == config_id)

    def points(self) -> list[ResultPoint]:
        """All results, with the core seconds that the search had spent by then."""
        proposals, began = self.journal.proposals, self.journal.began
        reached: dict[ConfigId, int] = {}
        spent = 0
        points = []
        for line in self.journal.results:
            spent += line.budget - reached.get(line.id, 0)
            reached[line.id] = line.budget
            if line.loss is not None:
                seconds = line.finished - began
                came = spent, line.budget, seconds
                points.append(ResultPoint(*came, line.loss, proposals[line.id].origin, line.id))
        return points

    def validated_points(self) -> list[ValidatedPoint]:
        """The finalists, the winner first; empty without a validation."""
        if self.validation is None:
            return []
        before = self.journal.results[: self.validation.results]
        known = self.points()[: sum(line.loss is not None for line in before)]
        points = {point.id: point for point in known}  # the last of each, at its largest budget
        spent = known[-1].spent + sum(line.budget for line in self.finalists)
        return [ValidatedPoint(points[line.id], spent, line.objective) for line in self.finalists]

    def core_seconds_left(self) -> int:
        """Core seconds left until all brackets are done, by their budgets."""
        reached = {line.id: line.budget for line in self.journal.results}  # by failures, too
        return max(core_seconds_to_run(self.rungs) - sum(reached.values()), 0)

    def validation_table(self) -> str:
        """The finalists' objectives over new seeds beside those of the search, in Markdown; empty
        without a validation."""
        if self.validation is None:
            return ""
        rows = [
            "| configuration | core seconds | runs | SEs | objective | in the search |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for line in self.finalists:
            searched = self.result_of(line.id)
            rows.append(
                f"| {configuration_name(line.id)} | {line.budget} | {line.info['runs']} | "
                f"{line.info['confirmed']} | {line.loss:.1f} | {searched.loss:.1f} "
                f"({searched.budget} core seconds) |"
            )
        return "\n".join(rows) + "\n"

    def bracket_table(self) -> str:
        """Results by bracket and budget, in Markdown."""
        rows = [
            "| bracket | core seconds | configurations | results | best objective | failed |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for rung in self.rungs:
            lines = [
                line
                for line in self.journal.results
                if (line.id[0], line.budget) == (rung.bracket, rung.budget)
            ]
            good = [line.loss for line in lines if line.loss is not None]
            if lines:
                best = f"{min(good):.1f}" if good else ""
                rows.append(
                    f"| {rung.bracket} | {rung.budget} | {rung.configurations} | {len(lines)} | "
                    f"{best} | {len(lines) - len(good)} |"
                )
        return "\n".join(rows) + "\n"


def _better(one: ResultLine, other: ResultLine) -> bool:
    """Whether a result has the larger budget, or the lower objective at the same."""
    assert one.loss is not None
    assert other.loss is not None
    return (one.budget, -one.loss) > (other.budget, -other.loss)
