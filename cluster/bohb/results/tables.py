"""A study's results as CSV, for readers of their own."""

import csv
import io
from collections.abc import Iterable, Sequence

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import ConfigLine, ResultLine

#: What the objective rests on (`Tally.info`).
TALLIED = ("core_seconds", "runs", "confirmed", "progress")

_COLUMNS = (
    "configuration",
    "bracket",
    "budget",  # core seconds
    "objective",  # core seconds per SE; empty of a failed job
    *TALLIED,
    "origin",
    "started",  # seconds since the first job was submitted
    "finished",
)


def results_csv(summary: StudySummary) -> str:
    """All results in their order, each with its configuration's values."""
    return _csv(summary, summary.journal.results)


def leaders_csv(summary: StudySummary) -> str:
    """The best result so far at each change of it, before any validation."""
    return _csv(summary, [line for _, line in summary.leaders()])


def _csv(summary: StudySummary, results: Sequence[ResultLine]) -> str:
    configs, began = summary.journal.proposals, summary.journal.began
    names = sorted({name for line in configs.values() for name in line.configuration})
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*_COLUMNS, *names])
    for line in results:
        writer.writerow(_row(line, configs[line.id], began, names))
    return text.getvalue()


def _row(line: ResultLine, config: ConfigLine, began: float, names: Iterable[str]) -> list[object]:
    times = [round(line.timestamps[event] - began, 3) for event in ("started", "finished")]
    return [
        configuration_name(line.id),
        line.id[0],
        line.budget,
        "" if line.loss is None else line.loss,
        *(line.info.get(name, "") for name in TALLIED),
        config.origin,
        *times,
        *(config.configuration.get(name, "") for name in names),
    ]
