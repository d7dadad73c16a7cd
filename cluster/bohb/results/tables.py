"""Results of a study as CSV."""

import csv
import io
from collections.abc import Sequence

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import ResultLine

#: Values of `Tally.info`, from which the objective is computed.
TALLIED = ("core_seconds", "runs", "confirmed", "progress")

_COLUMNS = (
    "configuration",
    "bracket",
    "budget",  # core seconds
    "objective",  # core seconds per SE; empty for a failure
    *TALLIED,
    "origin",
    "started",  # seconds since the first job was submitted
    "finished",
)


def results_csv(summary: StudySummary) -> str:
    """Return all results in order, with the values of their configurations."""
    return _csv(summary, summary.journal.results)


def leaders_csv(summary: StudySummary) -> str:
    """Return the results that were the best so far, before any validation."""
    return _csv(summary, [line for _, line in summary.leaders()])


def _csv(summary: StudySummary, results: Sequence[ResultLine]) -> str:
    configs, began = summary.journal.proposals, summary.journal.began
    names = sorted({name for line in configs.values() for name in line.configuration})
    text = io.StringIO()
    writer = csv.DictWriter(text, [*_COLUMNS, *names], restval="", lineterminator="\n")
    writer.writeheader()
    for line in results:
        writer.writerow(
            {
                "configuration": configuration_name(line.id),
                "bracket": line.id[0],
                "budget": line.budget,
                "objective": line.loss,  # None is written as an empty cell
                **{name: line.info[name] for name in TALLIED if name in line.info},
                "origin": configs[line.id].origin,
                "started": round(line.timestamps["started"] - began, 3),
                "finished": round(line.finished - began, 3),
                **configs[line.id].configuration,
            }
        )
    return text.getvalue()
