"""Tables that compare search methods, from the results of `benchmarks.search.compare`."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import permutation_test

from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import table
from benchmarks.nes.run import core_seconds_per_se
from benchmarks.search.recipes import TASKS
from cluster.bohb.study.profiles import METHODS

#: Names of results by their titles in tables. Earlier ones measured the scale of observations
#: over 1000 random steps.
COMPARISONS = {
    f"{task}{title}": f"search_{task}{suffix}"
    for task in TASKS
    for title, suffix in ((", scale of 1000 steps", "_scale-1000"), ("", ""))
}

Rows = Mapping[str, dict[str, Any]]


def comparisons() -> dict[str, dict[str, Any]]:
    """Return the existing results by title. Raises NotMeasured if there are none."""
    found = {}
    for title, name in COMPARISONS.items():
        with suppress(NotMeasured):
            found[title] = read_result(name, "rows")
    if not found:
        raise NotMeasured("`benchmarks/results/search_*.json`")
    return found


def core_seconds_per_solved(fresh: Sequence[dict[str, Any]]) -> float:
    """Return the expected core seconds to an SE on which fresh agents solve the task."""
    return core_seconds_per_se(fresh, "solved")


def by_method(rows: Rows, method: str) -> dict[int, list[dict[str, Any]]]:
    """Return the fresh runs of a method's searches by seed, where all runs have been made."""
    complete = max(len(row.get("fresh", ())) for row in rows.values())
    return {
        row["seed"]: row["fresh"]
        for row in rows.values()
        if row.get("method") == method and len(row.get("fresh", ())) == complete
    }


def p_value(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the two-sided p of paired samples (n,) of an exact permutation test on their logs."""
    result = permutation_test(
        (np.log(first), np.log(second)),
        lambda x, y, axis: np.mean(x - y, axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=np.inf,  # exact for any number of pairs
    )
    return float(result.pvalue)


def methods() -> str:
    """Return the table of the core seconds that the recipes of each method take."""
    head = (
        "task",
        "method",
        "searches",
        "fresh runs solved",
        "core seconds per solved run",
        "seeds on which BOHB's takes less, equal, more",
        "p against BOHB",
    )
    found = comparisons()
    rows = [row for title in found for row in method_rows(title, found[title]["rows"])]
    return table(head, rows, *found.values())


def method_rows(task: str, measured: Rows) -> list[list[str]]:
    """Return the rows of a task: the recipe `exogenous`, then each method."""
    found = {method: by_method(measured, method) for method in METHODS}
    default = measured["default"]["fresh"]
    rows = [[task, "the recipe `exogenous`", "-", *_quality([default]), "-", "-"]]
    for method, title in METHODS.items():
        if found[method]:
            quality = _quality([*found[method].values()])
            against = ("-", "-") if method == "bohb" else _against(found[method], found["bohb"])
            rows.append([task, title, str(len(found[method])), *quality, *against])
    return rows


def _against(
    other: dict[int, list[dict[str, Any]]], bohb: dict[int, list[dict[str, Any]]]
) -> tuple[str, str]:
    """Format wins, ties and losses of BOHB over common seeds, and their p."""
    seeds = sorted(other.keys() & bohb.keys())
    theirs, ours = (
        np.array([core_seconds_per_solved(runs[seed]) for seed in seeds]) for runs in (other, bohb)
    )
    pairs = ", ".join(str(n.sum()) for n in (ours < theirs, ours == theirs, ours > theirs))
    testable = len(seeds) > 1 and np.isfinite([*theirs, *ours]).all()
    return pairs, f"{p_value(theirs, ours):.2f}" if testable else "-"


def _quality(searches: Sequence[Sequence[dict[str, Any]]]) -> tuple[str, str]:
    runs = [run for fresh in searches for run in fresh]
    costs = [core_seconds_per_solved(fresh) for fresh in searches]
    spread = f" ({min(costs):.0f} to {max(costs):.0f})" if len(costs) > 1 else ""
    solved = sum(run["solved"] for run in runs)
    return f"{solved} of {len(runs)}", f"{np.median(costs):.0f}{spread}"
