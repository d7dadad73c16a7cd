"""The table and the picture of the comparison of search methods."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import permutation_test

from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import source, table
from benchmarks.search import studies
from cluster.bohb.profiles import METHODS
from cluster.tracking.pictures import BLUE, GREY, ORANGE

_COLOURS = {"bohb": BLUE, "hyperband": ORANGE, "random": GREY}


def expected_core_seconds(fresh: Sequence[dict[str, Any]]) -> float:
    """Expected core seconds to an SE on which fresh agents solve the task: those of all runs over
    the number of runs that did; infinite if none did."""
    solved = sum(run["solved"] for run in fresh)
    return sum(run["core_seconds"] for run in fresh) / solved if solved else float("inf")


def by_method(rows: dict[str, Any], method: str) -> dict[int, list[dict[str, Any]]]:
    """The fresh runs of each search by a method, by the search's seed."""
    return {
        row["seed"]: row["fresh"]
        for row in rows.values()
        if row.get("method") == method and "fresh" in row
    }


def p_value(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Two-sided p of paired samples (n,) under exchange within pairs, exact: with six pairs at
    least 1/32."""
    result = permutation_test(
        (np.log(one), np.log(other)),
        lambda x, y, axis: np.mean(x - y, axis=axis),
        permutation_type="samples",
        vectorized=True,
    )
    return float(result.pvalue)


def comparison() -> str:
    """What the recipes of each method are worth, and whether BOHB's are worth more."""
    rows, results = [], []
    for task in studies.TASKS:
        try:
            result = read_result(f"search_{task}")
        except NotMeasured:
            continue
        results.append(result)
        rows += _rows(task, result["rows"])
    if not results:
        raise NotMeasured("`benchmarks/results/search_*.json`")
    head = [
        "task",
        "method",
        "searches",
        "fresh runs solved",
        "core seconds an SE",
        "p against BOHB",
    ]
    return f"{table(head, rows)}\n\n{source(*results)}"


def _rows(task: str, measured: dict[str, Any]) -> list[list[str]]:
    found = {method: by_method(measured, method) for method in METHODS}
    default = measured["default"]["fresh"]
    rows = [[task, "the recipe `default`", "-", *_quality([default]), "-"]]
    for method, title in METHODS.items():
        if not found[method]:
            continue
        both = sorted(found[method].keys() & found["bohb"].keys())
        costs, bohbs = (
            np.array([expected_core_seconds(of[seed]) for seed in both])
            for of in (found[method], found["bohb"])
        )
        enough = method != "bohb" and len(both) > 1 and np.isfinite([*costs, *bohbs]).all()
        p = f"{p_value(costs, bohbs):.2f}" if enough else "-"
        rows.append([task, title, str(len(found[method])), *_quality([*found[method].values()]), p])
    return rows


def _quality(searches: Sequence[Sequence[dict[str, Any]]]) -> tuple[str, str]:
    runs = [run for fresh in searches for run in fresh]
    costs = [expected_core_seconds(fresh) for fresh in searches]
    spread = f" ({min(costs):.0f} to {max(costs):.0f})" if len(costs) > 1 else ""
    solved = sum(run["solved"] for run in runs)
    return f"{solved} of {len(runs)}", f"{np.median(costs):.0f}{spread}"


def picture(task: str, path: Path) -> None:
    """Draw a point for every search, and those of a seed joined by a line. Raises NotMeasured."""
    measured = read_result(f"search_{task}")["rows"]
    figure = Figure(figsize=(5, 3.2), layout="constrained")
    axes = figure.subplots()
    found = {method: by_method(measured, method) for method in METHODS}
    for seed in sorted(set.intersection(*(set(of) for of in found.values()))):
        axes.plot(
            [expected_core_seconds(of[seed]) for of in found.values()], color=GREY, lw=0.7, zorder=0
        )
    for place, (method, of) in enumerate(found.items()):
        costs = [expected_core_seconds(fresh) for fresh in of.values()]
        axes.scatter([place] * len(costs), costs, color=_COLOURS[method])
    default = expected_core_seconds(measured["default"]["fresh"])
    axes.axhline(default, color="black", lw=0.8, ls="--", label="the recipe default")
    axes.set_yscale("log")
    axes.set_xticks(range(len(METHODS)), [*METHODS.values()])
    axes.set_xlim(-0.5, len(METHODS) - 0.5)
    axes.set_ylabel("core seconds an SE, fresh seeds")
    axes.set_title(task)
    axes.legend(frameon=False, fontsize="small")
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)


TABLES: dict[str, Callable[[], str]] = {
    "search": comparison,
    "searches": studies.searches,
    "validations": studies.validations,
    "found": studies.found,
    "found-taught": studies.found_taught,
}
