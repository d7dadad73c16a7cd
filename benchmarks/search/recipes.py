"""The recipes that long searches began with and led to, other than the defaults of today.

`benchmarks.nes.seeds` runs all of them over seeds that no choice was made on.
"""

from contextlib import suppress
from typing import Any

import numpy as np
from scipy.stats import fisher_exact, mannwhitneyu

from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import mean_and_range, median_and_range, source, table
from benchmarks.nes.run import core_seconds_per_se

#: Recipes of a task in the order in which they came about, and the endings of their results over
#: seeds. Each is compared with the first. All ran while 1000 random steps measured the scale of
#: observations; the recipes `default` have run again since.
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


def measured(task: str) -> dict[str, Any]:
    """The runs over seeds of a task's recipes, by their titles; none if there is one recipe."""
    results = {}
    for title, ending in RECIPES[task].items():
        with suppress(NotMeasured):
            results[title] = read_result(f"nes_seeds_{task}{ending}", "runs")
    return results if len(results) > 1 else {}


def found() -> str:
    """The recipes that searches began with and led to, over fresh seeds."""
    rows: list[tuple[str, ...]] = []
    sources: list[dict[str, Any]] = []
    for task in RECIPES:
        results = measured(task)
        first: list[dict[str, Any]] | None = None
        for title, result in results.items():
            runs = result["runs"]
            p = _p_values(first, runs) if first else ("", "")
            rows.append((task, title, *_quality(runs), *p))
            first = first or runs
        sources += results.values()
    if not rows:
        raise NotMeasured("recipes of `benchmarks/search` over seeds")
    head = [
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
    ]
    return f"{table(head, rows)}\n\n{source(*sources)}"


def found_taught() -> str:
    """What the SEs of these recipes teach, a column for each recipe on whose SEs agents were
    trained. Raises NotMeasured."""
    parts = []
    for task in RECIPES:
        lessons = {
            title: [run["taught"] for run in result["runs"] if "taught" in run]
            for title, result in measured(task).items()
        }
        lessons = {title: taught for title, taught in lessons.items() if taught}
        if lessons:
            parts.append(_taught(task, lessons))
    if not parts:
        raise NotMeasured("agents on the SEs of recipes of `benchmarks/search`")
    return "\n\n".join(parts)


def _taught(task: str, lessons: dict[str, list[dict[str, Any]]]) -> str:
    rows = []
    for kind in dict.fromkeys(kind for taught in lessons.values() for on in taught for kind in on):
        cells = []
        for taught in lessons.values():
            means = [float(np.mean(on_se[kind]["scores"])) for on_se in taught if kind in on_se]
            cells.append(mean_and_range(means) if means else "-")
        rows.append((task, kind, *cells))
    head = ["task", "agent", *(f"{title}: {len(on)} SEs" for title, on in lessons.items())]
    return table(head, rows)


def _p_values(one: list[dict[str, Any]], other: list[dict[str, Any]]) -> tuple[str, str]:
    costs = [
        [run["core_seconds"] if run["confirmed"] else np.inf for run in runs]
        for runs in (one, other)
    ]
    solved = [sum(run["solved"] for run in runs) for runs in (one, other)]
    missed = [len(runs) - n for runs, n in zip((one, other), solved, strict=True)]
    p = mannwhitneyu(*costs).pvalue, fisher_exact([solved, missed]).pvalue
    return f"{p[0]:.2g}", f"{p[1]:.2g}"


def _quality(runs: list[dict[str, Any]]) -> tuple[str, ...]:
    costs = [run["core_seconds"] for run in runs]
    confirmed = sum(run["confirmed"] for run in runs)
    return (
        f"{sum(run['solved'] for run in runs)} of {len(runs)}",
        f"{confirmed} of {len(runs)}",
        f"{sum(run['solved'] and run['confirmed'] for run in runs)} of {confirmed}",
        median_and_range(costs),
        f"{core_seconds_per_se(runs):.0f}",
        f"{np.median([run['final_train_steps'] for run in runs]):.0f}",
    )
