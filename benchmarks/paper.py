"""Tables of docs/experiments.md, from the committed `benchmarks/experiments`."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.machine import NotMeasured
from benchmarks.markdown import table
from bilevel.tasks import BUILT_IN_TASKS
from cluster.experiments.authors import authors_figures
from cluster.experiments.conditions import title_of

FOLDER = Path(__file__).parent / "experiments"

Findings = dict[str, dict[str, Any]]


def findings_of(experiment: str) -> Findings:
    """Read the findings of an experiment by task. Raises NotMeasured if there are none."""
    found = {}
    for task in BUILT_IN_TASKS:
        path = FOLDER / task / f"experiment-{experiment}-seed0" / "findings.json"
        if path.exists():
            found[task] = json.loads(path.read_text())
    if not found:
        raise NotMeasured(f"the experiment `{experiment}`")
    return found


def _with_commands(text: str, found: Findings) -> str:
    commands = ", ".join(f"`{findings['command']}`" for findings in found.values())
    return f"{text}\n\n({commands})"


def _number(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


_SUCCESS_HEAD = (
    *("solved in some generation", "in the last generation", "by the returned SE"),
    *("score at the end", "first solved in generation", "core seconds until then", "generations"),
    *("core seconds", "update norm"),
)

#: The authors' columns: title, name of the value, and format.
_SUCCESS_OF_AUTHORS = (
    ("in some generation", "ever_solved", ".0%"),
    ("at the end", "solved_at_end", ".0%"),
    ("score", "score_at_end", "g"),
    ("first in generation", "median_first_solved", "g"),
    ("core seconds", "core_seconds", ".0f"),
)


def _success_cells(row: dict[str, Any]) -> list[str]:
    shares = (row[name] for name in ("ever_solved", "solved_at_end", "best_se_solves"))
    spread = f" ± {row['score_at_end_std']:.0f}" if row["runs"] > 1 else ""
    return [
        *(f"{round(share * row['runs'])} of {row['runs']}" for share in shares),
        f"{row['score_at_end']:.0f}{spread}",
        _number(row["median_first_solved"]),
        _number(row["core_seconds_first_solved"]),
        f"{row['generations']:g}",
        f"{row['core_seconds']:.0f}",
        f"{row['update_norm']:.2f}",
    ]


def success() -> str:
    """Return the table of NES runs that solve their task, next to the authors' results."""
    authors = {
        (figure.task, figure.row["condition"], figure.what): figure.value
        for figure in authors_figures()
        if figure.experiment == "success"
    }
    rows, found = [], findings_of("success")
    for task, findings in found.items():
        ours = {row["condition"]: _success_cells(row) for row in findings["summary"]}
        for condition, cells in ours.items():
            theirs = [
                (authors.get((task, condition, name)), form)
                for _, name, form in _SUCCESS_OF_AUTHORS
            ]
            of_authors = ("-" if value is None else f"{value:{form}}" for value, form in theirs)
            rows.append([task, title_of(condition), *cells, *of_authors])
    head = ["task", "condition", *_SUCCESS_HEAD]
    head += [f"authors: {title}" for title, _, _ in _SUCCESS_OF_AUTHORS]
    return _with_commands(table(head, rows), found)


def transfer() -> str:
    """Return the table of agents by training source, next to the authors' results."""
    authors = {
        (figure.task, figure.row.get("agent"), figure.row.get("source"), figure.what): figure.value
        for figure in authors_figures()
        if figure.experiment == "transfer"
    }
    rows, found = [], findings_of("transfer")
    for task, findings in found.items():
        for row in findings["summary"]:
            theirs = (
                authors.get((task, row["agent"], row["source"], name))
                for name in ("test_return", "train_steps")
            )
            rows.append(
                [
                    task,
                    row["agent"],
                    title_of(row["source"]),
                    row["agents"],
                    f"{row['test_return']:.1f} ± {row['test_return_std']:.1f}",
                    _number(row["standard_error_over_ses"], 1),
                    f"{row['train_steps']:.0f} ± {row['train_steps_std']:.0f}",
                    f"{row['train_steps_median']:.0f}",
                    f"{row['share_of_agents_solving']:.0%}",
                    *("-" if value is None else f"{value:g}" for value in theirs),
                ]
            )
    head = ["task", "agent", "trained on", "agents", "test return", "its standard error"]
    head += ["train steps", "median", "agents that solve it"]
    head += ["authors' return", "authors' train steps"]
    return _with_commands(table(head, rows), found)


def sample_efficiency() -> str:
    """Return the table of train steps until the agents' mean return solves the task."""
    found = findings_of("sample-efficiency")
    rows = [
        [
            task,
            title_of(row["source"]),
            row["agents"],
            "not before all had stopped"
            if row["train_steps_until_mean_return_solves"] is None
            else f"{row['train_steps_until_mean_return_solves']:.0f}",
            f"{row['train_steps_at_stop']:.0f} ± {row['train_steps_at_stop_std']:.0f}",
            f"{row['return_at_stop']:.1f} ± {row['return_at_stop_std']:.1f}",
        ]
        for task, findings in found.items()
        for row in findings["summary"]
    ]
    head = ["task", "trained on", "agents", "train steps until the mean return solves the task"]
    head += ["train steps at the stop", "return at the stop"]
    return _with_commands(table(head, rows), found)


TABLES: dict[str, Callable[[], str]] = {
    "success": success,
    "transfer": transfer,
    "sample-efficiency": sample_efficiency,
}
