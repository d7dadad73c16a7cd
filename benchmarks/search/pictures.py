"""Draws the pictures of docs/tuning.md: each committed study, and the comparison of search methods.

python -m benchmarks.search.pictures
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from benchmarks.search.comparison import (
    COMPARISONS,
    by_method,
    comparisons,
    core_seconds_per_solved,
)
from benchmarks.search.studies import committed, summary
from cluster.bohb.results.pictures import objective_against_cost
from cluster.bohb.study.profiles import METHODS
from cluster.bohb.view import hyperparameter_picture
from cluster.experiments.style import GUIDE, SERIES, column, styled

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"

_LOOKS = dict(zip(METHODS, SERIES, strict=False))


@styled()
def compared(title: str, measured: dict[str, Any]) -> Figure:
    """The rows of `benchmarks.search.compare`: a point for every search, a line that joins those of
    a seed, and the median of each method."""
    figure = column(2.3)
    axes = figure.subplots()
    found = {method: by_method(measured, method) for method in METHODS}
    for seed in sorted(set.intersection(*(set(of) for of in found.values()))):
        costs = [core_seconds_per_solved(of[seed]) for of in found.values()]
        axes.plot(costs, color=GUIDE, lw=0.4, alpha=0.5, zorder=0)
    for place, (method, of) in enumerate(found.items()):
        costs = [core_seconds_per_solved(fresh) for fresh in of.values()]
        look = _LOOKS[method]
        axes.scatter([place] * len(costs), costs, s=14, color=look.colour, marker=look.marker)
        if costs:
            ends = place - 0.2, place + 0.2
            axes.hlines(float(np.median(costs)), *ends, color=look.colour, lw=2)
    if "default" in measured:
        default = core_seconds_per_solved(measured["default"]["fresh"])
        axes.axhline(default, color=GUIDE, lw=0.7, ls="--", label="the recipe default")
        axes.legend(loc="lower right")
    axes.set_ylim(bottom=0)
    axes.set_xticks(range(len(METHODS)), [*METHODS.values()])
    axes.set_xlim(-0.5, len(METHODS) - 0.5)
    axes.set_ylabel("core seconds per solved run")
    axes.set_title(f"{title} (bars: medians)")
    return figure


def _save(figure: Figure, name: str) -> None:
    path = PICTURES / f"{name}.svg"
    with rc_context({"svg.hashsalt": name}):  # the same picture gives the same file
        figure.savefig(path, metadata={"Date": None})
    print(f"drawn: {path}")


def main() -> None:
    """Draw all that has been measured."""
    for study in committed():
        told = summary(study)
        points, validated = told.points(), told.validated_points()
        figure = objective_against_cost(points, validated, study.task, study.method_name)
        _save(figure, f"search-{study.task.id}-{study.name}")
        _save(hyperparameter_picture(study, told), f"hyperparameters-{study.task.id}-{study.name}")
    for title, result in comparisons().items():
        if any(by_method(result["rows"], method) for method in METHODS):
            name = COMPARISONS[title].removeprefix("search_")
            _save(compared(title, result["rows"]), f"comparison-{name}")


if __name__ == "__main__":
    main()
