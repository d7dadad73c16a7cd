"""The tables of docs/experiments.md, from the committed home `benchmarks/experiments`."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.machine import NotMeasured
from benchmarks.markdown import table
from bilevel.tasks import BUILT_IN_TASKS
from cluster.experiments.authors import authors_figures
from cluster.experiments.conditions import title_of

HOME = Path(__file__).parent / "experiments"


def _findings(experiment: str) -> dict[str, dict[str, Any]]:
    """What an experiment of the size local has found, by task. Raises NotMeasured without any."""
    found = {}
    for task in BUILT_IN_TASKS:
        path = HOME / task / f"experiment-{experiment}-seed0" / "findings.json"
        if path.exists():
            found[task] = json.loads(path.read_text())
    if not found:
        raise NotMeasured(f"the experiment `{experiment}`")
    return found


def _commands(found: dict[str, dict[str, Any]]) -> str:
    return "(" + ", ".join(f"`{findings['command']}`" for findings in found.values()) + ")"


#: Columns of what `success` has found of a condition.
_SUCCESS = (
    *("solved in some generation", "in the last generation", "by the SE that is handed over"),
    *("score at the end", "first solved in generation", "core seconds until then", "generations"),
    *("core seconds", "update norm"),
)

#: Columns of what the authors have.
_AUTHORS = "in some generation", "at the end", "score", "first in generation", "core seconds"


def _success(row: dict[str, Any]) -> list[str]:
    shares = (row[name] for name in ("ever_solved", "solved_at_end", "handed_over_solved"))
    spread = f" ± {row['score_at_end_std']:.0f}" if row["runs"] > 1 else ""
    return [
        *(f"{round(share * row['runs'])} of {row['runs']}" for share in shares),
        f"{row['score_at_end']:.0f}{spread}",
        _or_none(row["median_first_solved"]),
        _or_none(row["core_seconds_first_solved"]),
        f"{row['generations']:g}",
        f"{row['core_seconds']:.0f}",
        f"{row['update_norm']:.2f}",
    ]


def success() -> str:
    """NES runs that solve their task, ours and the authors'."""
    authors = {
        (figure.task, figure.row["condition"], figure.what): figure
        for figure in authors_figures()
        if figure.experiment == "success"
    }
    rows, found = [], _findings("success")
    for task, findings in found.items():
        ours = {row["condition"]: _success(row) for row in findings["summary"]}
        theirs = {condition for of, condition, _ in authors if of == task}
        for condition in [*ours, *sorted(theirs - {*ours})]:
            ever, end, score, first, seconds = (
                authors.get((task, condition, what))
                for what in (
                    *("ever_solved", "solved_at_end"),
                    *("score_at_end", "median_first_solved", "core_seconds"),
                )
            )
            rows.append(
                [
                    task,
                    title_of(condition),
                    *ours.get(condition, ["-"] * len(_SUCCESS)),
                    *("-" if figure is None else f"{figure.value:.0%}" for figure in (ever, end)),
                    *("-" if figure is None else f"{figure.value:g}" for figure in (score, first)),
                    "-" if seconds is None else f"{seconds.value:.0f}",
                ]
            )
    head = ["task", "condition", *_SUCCESS, *(f"authors: {what}" for what in _AUTHORS)]
    return f"{table(head, rows)}\n\n{_commands(found)}"


def _or_none(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def transfer() -> str:
    """Agents by what they were trained on, ours and the authors'."""
    authors = {
        (figure.task, figure.row.get("agent"), figure.row.get("source"), figure.what): figure
        for figure in authors_figures()
        if figure.experiment == "transfer"
    }
    rows, found = [], _findings("transfer")
    for task, findings in found.items():
        for row in findings["summary"]:
            theirs = [
                authors.get((task, row["agent"], row["source"], what))
                for what in ("test_return", "train_steps")
            ]
            rows.append(
                [
                    task,
                    row["agent"],
                    title_of(row["source"]),
                    row["agents"],
                    f"{row['test_return']:.1f} ± {row['test_return_std']:.1f}",
                    _or_none(row["standard_error_over_ses"], 1),
                    f"{row['train_steps']:.0f} ± {row['train_steps_std']:.0f}",
                    f"{row['train_steps_median']:.0f}",
                    f"{row['share_of_agents_solving']:.0%}",
                    *("-" if figure is None else f"{figure.value:g}" for figure in theirs),
                ]
            )
    head = ["task", "agent", "trained on", "agents", "test return", "its standard error"]
    head += ["train steps", "median", "agents that solve it"]
    head += ["authors' return", "authors' train steps"]
    return f"{table(head, rows)}\n\n{_commands(found)}"


def sample_efficiency() -> str:
    """Train steps until the mean return of the agents solves the task."""
    found = _findings("sample-efficiency")
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
    return f"{table(head, rows)}\n\n{_commands(found)}"


TABLES: dict[str, Callable[[], str]] = {
    "success": success,
    "transfer": transfer,
    "sample-efficiency": sample_efficiency,
}
