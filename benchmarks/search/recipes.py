"""The recipes that searches started from and found, run over fresh seeds.

The runs are results of `benchmarks.nes.seeds`.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from scipy.stats import fisher_exact, mannwhitneyu

from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import median_and_range, table
from benchmarks.nes.run import core_seconds_per_se

#: Recipes of a task in chronological order, and the suffixes of their results. Each is compared
#: with the first. All runs measured the scale of observations over 1000 random steps.
RECIPES = {
    "CartPole-v0": {
        "made by hand": "_by-hand",
        "first search, best result": "_unvalidated",
        "first search, incumbent": "_found",
        "second search, incumbent": "_scale-1000",
    },
    "Acrobot-v1": {"made by hand": "_by-hand", "search, incumbent": "_scale-1000"},
}
TASKS = tuple(RECIPES)

Runs = Sequence[dict[str, Any]]


def measured(task: str) -> dict[str, Any]:
    """Return the existing results of a task's recipes by title."""
    results = {}
    for title, suffix in RECIPES[task].items():
        with suppress(NotMeasured):
            results[title] = read_result(f"nes_seeds_{task}{suffix}", "runs")
    return results


def found() -> str:
    """Return the table of the recipes over fresh seeds. Raises NotMeasured."""
    rows: list[tuple[str, ...]] = []
    results: list[dict[str, Any]] = []
    for task in RECIPES:
        first: Runs = []
        for title, result in measured(task).items():
            runs = result["runs"]
            rows.append(
                (task, title, *quality(runs), *(p_values(first, runs) if first else ("", "")))
            )
            first = first or runs
            results.append(result)
    if not rows:
        raise NotMeasured("recipes of `benchmarks/search` over seeds")
    head = (
        "task",
        "recipe",
        "solved",
        "confirmed",
        "confirmed runs that solve the task",
        "core seconds, median and range",
        "core seconds per SE",
        "train steps of an agent",
        "p of core seconds",
        "p of solved",
    )
    return table(head, rows, *results)


def p_values(first: Runs, second: Runs) -> tuple[str, str]:
    """Format the p of core seconds, infinite for unconfirmed runs, and of solved runs."""
    costs = [
        [run["core_seconds"] if run["confirmed"] else np.inf for run in runs]
        for runs in (first, second)
    ]
    solved = [sum(run["solved"] for run in runs) for runs in (first, second)]
    missed = [len(runs) - n for runs, n in zip((first, second), solved, strict=True)]
    p = mannwhitneyu(*costs).pvalue, fisher_exact([solved, missed]).pvalue
    return f"{p[0]:.2g}", f"{p[1]:.2g}"


def quality(runs: Runs) -> tuple[str, ...]:
    """Format successes, costs and train steps of runs."""
    confirmed = sum(run["confirmed"] for run in runs)
    return (
        f"{sum(run['solved'] for run in runs)} of {len(runs)}",
        f"{confirmed} of {len(runs)}",
        f"{sum(run['solved'] and run['confirmed'] for run in runs)} of {confirmed}",
        median_and_range([run["core_seconds"] for run in runs]),
        f"{core_seconds_per_se(runs):.0f}",
        f"{np.median([run['final_train_steps'] for run in runs]):.0f}",
    )
