"""Tables of a study as CSV."""

from collections.abc import Sequence
from typing import Any

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import ResultLine

#: Values of `Tally.info`, from which the objective is computed.
TALLIED = ("core_seconds", "runs", "confirmed", "progress")


def results_csv(summary: StudySummary) -> str:
    """Return all results in order, with the values of their configurations."""
    results = [*summary.journal.results]  # before the proposals: both grow
    configs, began = summary.journal.proposals, summary.journal.began
    rows = [
        {
            **_row(line),
            "origin": configs[line.id].origin,
            "started": round(line.timestamps["started"] - began, 3),  # seconds
            "finished": round(line.finished - began, 3),
            **configs[line.id].configuration,
        }
        for line in results
    ]
    return _csv(rows)


def brackets_csv(summary: StudySummary) -> str:
    """Return the number of results and the best objective by bracket and budget."""
    rows = []
    for rung in summary.rungs:
        key = {"bracket": rung.bracket, "budget": rung.budget}
        lines = [r for r in summary.journal.results if (r.id[0], r.budget) == (*key.values(),)]
        losses = [line.loss for line in lines if line.loss is not None]
        counts = {"results": len(lines), "failed": len(lines) - len(losses)}
        rows.append({**key, **counts, "best_objective": min(losses, default=None)})
    return _csv(rows)


def validation_csv(summary: StudySummary) -> str:
    """Return the finalists' results over new seeds, and their objectives in the search."""
    searched = {line.id: line.objective for line in summary.journal.successes}
    return _csv([{**_row(line), "searched": searched[line.id]} for line in summary.finalists])


def _row(line: ResultLine) -> dict[str, Any]:
    return {
        "configuration": configuration_name(line.id),
        "budget": line.budget,  # core seconds
        "objective": line.loss,  # core seconds per SE; a failure's cell is empty
        **{name: line.info.get(name) for name in TALLIED},
    }


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    import pandas as pd  # takes a second

    return str(pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"))
