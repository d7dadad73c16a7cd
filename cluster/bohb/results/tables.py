"""Results of a study as CSV."""

import csv
import io
from collections.abc import Sequence

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import ResultLine

#: Values of `Tally.info`, from which the objective is computed.
TALLIED = ("core_seconds", "runs", "confirmed", "progress")


def results_csv(summary: StudySummary) -> str:
    """Return all results in order, with the values of their configurations."""
    return _csv(summary, summary.journal.results)


def leaders_csv(summary: StudySummary) -> str:
    """Return the results that were the best so far, before any validation."""
    return _csv(summary, [line for _, line in summary.leaders()])


def _csv(summary: StudySummary, results: Sequence[ResultLine]) -> str:
    configs, began = summary.journal.proposals, summary.journal.began
    names = sorted({name for line in configs.values() for name in line.configuration})
    rows = [
        {
            "configuration": configuration_name(line.id),
            "bracket": line.id[0],
            "budget": line.budget,  # core seconds
            "objective": line.loss,  # core seconds per SE; a failure's cell is empty
            **{name: line.info.get(name) for name in TALLIED},
            "origin": configs[line.id].origin,
            "started": round(line.timestamps["started"] - began, 3),  # seconds
            "finished": round(line.finished - began, 3),
            **{name: configs[line.id].configuration.get(name) for name in names},
        }
        for line in results
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0] if rows else (), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
