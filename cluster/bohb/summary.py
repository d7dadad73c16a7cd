"""Summary of a study's journal so far: incumbent, costs, bracket table."""

from dataclasses import dataclass

from cluster.bohb.brackets import Rung, core_seconds_to_run
from cluster.bohb.journal import ConfigId, Configuration, Journal, ResultLine


@dataclass(frozen=True)
class ResultPoint:
    """A result of the search, for the plot of objective against cost."""

    spent: int  # core seconds of the whole search when the result came, by budgets
    budget: int
    seconds: float  # since the first job began, pauses included
    objective: float
    model_based: bool


@dataclass(frozen=True)
class StudySummary:
    """Summary of a journal for the brackets in `rungs`; it follows the journal as that grows."""

    journal: Journal
    rungs: list[Rung]

    @property
    def incumbent(self) -> ResultLine | None:
        """The best result at the largest budget that has results (as in hpbandster)."""
        changes = self.incumbents()
        return changes[-1][1] if changes else None

    def incumbents(self) -> list[tuple[int, ResultLine]]:
        """Each change of the incumbent, with the number (from 1) of the result that caused it."""
        changes: list[tuple[int, ResultLine]] = []
        best: ResultLine | None = None
        for number, line in enumerate(self.journal.results, start=1):
            if line.loss is not None and (best is None or _better(line, best)):
                best = line
                changes.append((number, line))
        return changes

    @property
    def model_based(self) -> int:
        """Number of configurations that the model proposed."""
        return sum(bool(line.info.get("model_based_pick")) for line in self.journal.configs)

    def configuration(self, config_id: ConfigId) -> Configuration:
        """The configuration with that id."""
        return next(c.configuration for c in self.journal.configs if c.id == config_id)

    def points(self) -> list[ResultPoint]:
        """All results, with the core seconds that the search had spent by then."""
        picks = {line.id: bool(line.info.get("model_based_pick")) for line in self.journal.configs}
        reached: dict[ConfigId, int] = {}
        spent = 0
        began = min((line.timestamps["submitted"] for line in self.journal.results), default=0.0)
        points = []
        for line in self.journal.results:
            spent += line.budget - reached.get(line.id, 0)
            reached[line.id] = line.budget
            if line.loss is not None:
                seconds = line.finished - began
                point = ResultPoint(spent, line.budget, seconds, line.loss, picks[line.id])
                points.append(point)
        return points

    def core_seconds_left(self) -> int:
        """Core seconds left until all brackets are done, by their budgets."""
        reached: dict[ConfigId, int] = {}
        for line in self.journal.results:
            reached[line.id] = max(line.budget, reached.get(line.id, 0))
        return max(core_seconds_to_run(self.rungs) - sum(reached.values()), 0)

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
