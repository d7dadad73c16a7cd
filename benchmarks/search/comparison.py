"""The tables that compare search methods, from what `benchmarks.search.compare` has measured."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution
from scipy.stats import fisher_exact, permutation_test, spearmanr

from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import median_and_range, source, table
from benchmarks.nes.run import core_seconds_per_se
from benchmarks.search.outcomes import at_largest, with_an_se
from benchmarks.search.recipes import TASKS
from cluster.bohb.study.journal import Origin
from cluster.bohb.study.profiles import METHODS

#: Incumbents from which on their order is compared.
_FEWEST = 4

#: What `benchmarks.search.compare` has measured, by what the tables call it: while 1000 random
#: steps measured the scale of observations, and as it is today.
COMPARISONS = {
    f"{task}{title}": f"search_{task}{ending}"
    for task in TASKS
    for title, ending in ((", scale of 1000 steps", "_scale-1000"), ("", ""))
}


def comparisons() -> dict[str, dict[str, Any]]:
    """Those of them that are there, by the same titles. Raises NotMeasured without any."""
    found = {}
    for title, name in COMPARISONS.items():
        with suppress(NotMeasured):
            found[title] = read_result(name, "rows")
    if not found:
        raise NotMeasured("`benchmarks/results/search_*.json`")
    return found


def core_seconds_per_solved(fresh: Sequence[dict[str, Any]]) -> float:
    """Expected core seconds to an SE on which fresh agents solve the task."""
    return core_seconds_per_se(fresh, "solved")


def by_method(rows: dict[str, Any], method: str) -> dict[int, list[dict[str, Any]]]:
    """The fresh runs of each search by a method, by the search's seed, where all have been
    made."""
    complete = max(len(row.get("fresh", ())) for row in rows.values())
    return {
        row["seed"]: row["fresh"]
        for row in rows.values()
        if row.get("method") == method and len(row.get("fresh", ())) == complete
    }


def p_value(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Two-sided p of paired samples (n,) under exchange within pairs, exact: with six pairs at
    least 1/32."""
    result = permutation_test(
        (np.log(one), np.log(other)),
        lambda x, y, axis: np.mean(x - y, axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=np.inf,  # by default it samples, from 14 pairs on
    )
    return float(result.pvalue)


def _compared(rows_of: Callable[[str, dict[str, Any]], Sequence[Sequence[str]]]) -> list[Any]:
    """The rows of a table, those of each comparison after the other. Raises NotMeasured."""
    return [
        row for title, result in comparisons().items() for row in rows_of(title, result["rows"])
    ]


def largest_budget() -> str:
    """How the configurations did that each method gave the largest budget: whether rungs choose
    better ones than chance, and a model better ones than rungs alone. Of seeds that all methods
    have searched. Raises NotMeasured."""
    head = [
        "task",
        "method",
        "searches",
        "configurations",
        "found an SE",
        "of those proposed by the model",
        "with an SE, per search",
        "p of the share against random search",
        "p against Hyperband",
    ]
    return table(head, _compared(_largest_budget))


def _largest_budget(task: str, measured: Mapping[str, Any]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    before: dict[str, tuple[int, int]] = {}
    done = {(row["method"], row["seed"]) for row in measured.values() if "search" in row}
    seeds = {seed for _, seed in done if all((method, seed) in done for method in METHODS)}
    for method in ("random", "hyperband", "bohb"):
        searches = [
            at_largest(row["search"]["outcomes"])
            for row in measured.values()
            if row.get("method") == method and row["seed"] in seeds
        ]
        if not searches:
            continue
        by_origin = {
            origin: [one for search in searches for one in search[origin]] for origin in searches[0]
        }
        every = [one for found in by_origin.values() for one in found]
        of_model = by_origin[Origin.MODEL.value]
        with_one = with_an_se(every)
        counts = with_one, len(every) - with_one
        rows.append(
            (
                task,
                METHODS[method],
                str(len(searches)),
                str(len(every)),
                str(with_one),
                f"{with_an_se(of_model)} of {len(of_model)}" if of_model else "",
                f"{with_one / len(searches):.1f}",
                *(
                    f"{fisher_exact([before[other], counts]).pvalue:.2g}" if other in before else ""
                    for other in ("random", "hyperband")
                ),
            )
        )
        before[method] = counts
    return rows


def _recipe(row: Mapping[str, Any]) -> str:
    """The recipe of a row as a key: several searches may have found the same one."""
    return repr(sorted(row.get("search", {}).get("configuration", {}).items()))


def incumbents() -> str:
    """What the validation of a search tells of its incumbent: the objective there beside that over
    the fresh runs. Raises NotMeasured."""
    head = [
        "task",
        "incumbents",
        "core seconds per SE, fresh runs over validation",
        "rank correlation",
        "p",
        "standard deviation of a fresh run over its mean",
    ]
    return table(head, _compared(_incumbents))


def _incumbents(task: str, measured: dict[str, Any]) -> list[tuple[str, ...]]:
    found = {method: by_method(measured, method) for method in METHODS}
    each: dict[str, tuple[float, float, float]] = {}  # by configuration: methods may agree
    for row in measured.values():
        fresh = found.get(row.get("method"), {}).get(row.get("seed"))
        if fresh is None:
            continue
        costs = np.array([run["core_seconds"] for run in fresh])
        key, fresh_objective = _recipe(row), core_seconds_per_se(fresh)
        each[key] = row["search"]["incumbent"], fresh_objective, float(costs.std() / costs.mean())
    if len(each) < _FEWEST:
        return []
    validated, objective, spread = np.array([*each.values()]).T
    ratios, agreement = objective / validated, spearmanr(validated, objective)
    return [
        (
            task,
            str(len(each)),
            median_and_range(ratios.tolist(), ".2f"),
            f"{agreement.statistic:.2f}",
            f"{agreement.pvalue:.2g}",
            median_and_range(spread.tolist(), ".2f"),
        )
    ]


def noise() -> str:
    """What the core time of a fresh run depends on: its recipe, its seed, or neither. Raises
    NotMeasured."""
    head = [
        "task",
        "recipes",
        "seeds",
        *(f"variance of log core seconds: {of}" for of in ("recipes", "seeds", "the rest")),
        "p of seeds",
    ]
    return table(head, _compared(_noise))


def _noise(task: str, measured: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Components of a two-way analysis of variance without replicates: all recipes ran with the
    same seeds. A recipe that several searches found counts once."""
    complete = max(len(row.get("fresh", ())) for row in measured.values())
    if not complete:
        return []
    each = {
        _recipe(row): [np.log(run["core_seconds"]) for run in row["fresh"]]
        for row in measured.values()
        if len(row.get("fresh", ())) == complete
    }
    costs = np.array([*each.values()])
    recipes, seeds = costs.shape
    if min(recipes, seeds) < _FEWEST:
        return []
    of_recipe, of_seed = costs.mean(1, keepdims=True), costs.mean(0, keepdims=True)
    left = recipes * seeds - recipes - seeds + 1
    rest = float(((costs - of_recipe - of_seed + costs.mean()) ** 2).sum() / left)
    between_seeds = recipes * float(of_seed.var(ddof=1))
    between_recipes = seeds * float(of_recipe.var(ddof=1))
    return [
        (
            task,
            str(recipes),
            str(seeds),
            f"{max(between_recipes - rest, 0.0) / seeds:.2f}",
            f"{max(between_seeds - rest, 0.0) / recipes:.2f}",
            f"{rest:.2f}",
            f"{f_distribution.sf(between_seeds / rest, seeds - 1, left):.2g}",
        )
    ]


def methods() -> str:
    """What the recipes of each method are worth, and whether BOHB's are worth more. Raises
    NotMeasured."""
    head = [
        "task",
        "method",
        "searches",
        "fresh runs solved",
        "core seconds per solved run",
        "seeds on which BOHB's takes less, equal, more",
        "p against BOHB",
    ]
    return f"{table(head, _compared(_rows))}\n\n{source(*comparisons().values())}"


def _rows(task: str, measured: dict[str, Any]) -> list[list[str]]:
    found = {method: by_method(measured, method) for method in METHODS}
    default = measured["default"]["fresh"]
    rows = [[task, "the recipe `default`", "-", *_quality([default]), "-", "-"]]
    for method, title in METHODS.items():
        if not found[method]:
            continue
        both = sorted(found[method].keys() & found["bohb"].keys())
        costs, bohbs = (
            np.array([core_seconds_per_solved(of[seed]) for seed in both])
            for of in (found[method], found["bohb"])
        )
        pairs = [
            int((bohbs < costs).sum()),
            int((bohbs == costs).sum()),
            int((bohbs > costs).sum()),
        ]
        told = ", ".join(map(str, pairs)) if method != "bohb" else "-"
        enough = method != "bohb" and len(both) > 1 and np.isfinite([*costs, *bohbs]).all()
        p = f"{p_value(costs, bohbs):.2f}" if enough else "-"
        quality = _quality([*found[method].values()])
        rows.append([task, title, str(len(found[method])), *quality, told, p])
    return rows


def _quality(searches: Sequence[Sequence[dict[str, Any]]]) -> tuple[str, str]:
    runs = [run for fresh in searches for run in fresh]
    costs = [core_seconds_per_solved(fresh) for fresh in searches]
    spread = f" ({min(costs):.0f} to {max(costs):.0f})" if len(costs) > 1 else ""
    solved = sum(run["solved"] for run in runs)
    return f"{solved} of {len(runs)}", f"{np.median(costs):.0f}{spread}"
