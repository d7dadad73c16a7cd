"""Pictures of a study."""

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from bilevel.tasks import Task
from cluster.bohb.results.importance import Importance
from cluster.bohb.results.summary import ResultPoint, ValidatedPoint
from cluster.bohb.study.journal import Origin
from cluster.pictures import BLUE, GREY, ORANGE

Floats = NDArray[np.float64]


def objective_against_cost(
    points: Sequence[ResultPoint], validated: Sequence[ValidatedPoint], task: Task, title: str
) -> Figure:
    """Plot every result over the core seconds spent until then, the best one at the largest budget
    so far, and the finalists over new seeds, the winner first."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel("core seconds spent by the search (marker size: budget of the result)")
    axes.set_ylabel("objective: core seconds per SE")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_title(f"{title}, {task.id}")
    axes.spines[["top", "right"]].set_visible(False)
    if not points:
        return figure
    _plot_results(axes, points)
    _plot_finalists(axes, validated)
    ends = [point.spent for point in points] + [point.spent for point in validated]
    axes.set_xlim(0, 1.03 * max(ends))
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=2)
    return figure


def _plot_results(axes: Axes, points: Sequence[ResultPoint]) -> None:
    smallest = min(point.budget for point in points)
    for model_based, marker, colour in ((False, "o", GREY), (True, "D", BLUE)):
        chosen = [point for point in points if (point.origin is Origin.MODEL) is model_based]
        axes.scatter(
            [point.spent for point in chosen],
            [point.objective for point in chosen],
            s=[16 * point.budget / smallest for point in chosen],
            marker=marker,
            color=colour,
            alpha=0.6,
            lw=0,
            label="; ".join(dict.fromkeys(point.origin.value for point in chosen)),
        )
    largest = max(point.budget for point in points)
    ranked = [point for point in points if point.budget == largest]
    best = np.minimum.accumulate([point.objective for point in ranked])
    label = f"best so far after {largest} core seconds: {best[-1]:.0f}"
    axes.step([p.spent for p in ranked], best, where="post", color=ORANGE, label=label)


def _plot_finalists(axes: Axes, validated: Sequence[ValidatedPoint]) -> None:
    """Connect each finalist's result in the search with that over new seeds."""
    for point in validated:
        before = point.searched
        xs, ys = [before.spent, point.spent], [before.objective, point.objective]
        axes.plot(xs, ys, color="black", ls=":", lw=0.9, zorder=2)
    for chosen, marker, size, colour, name in (
        (validated[1:], "X", 50, "black", "other finalists, new seeds"),
        (validated[:1], "*", 160, ORANGE, "incumbent, new seeds"),
    ):
        xs, ys = [p.spent for p in chosen], [p.objective for p in chosen]
        label = f"{name}: {', '.join(f'{y:.0f}' for y in ys)}" if chosen else None
        axes.scatter(xs, ys, marker=marker, s=size, color=colour, zorder=3, label=label)


def hyperparameters(
    tried: Floats,
    incumbents: Floats,
    recipe: Floats,
    names: Sequence[str],
    found: Importance | None,
    title: str,
) -> Figure:
    """Plot d hyperparameters: the values of all configurations, the path from the recipe to the
    incumbent, and the importance of each.

    `tried` (n, d), the best first, `incumbents` (m, d) and `recipe` (d,) are scaled to [0, 1] over
    the search space, with NaN outside. Colours are ranks.
    """
    figure = Figure(figsize=(9, 1.6 + 0.42 * len(names)), layout="constrained")
    places, bars = figure.subplots(1, 2, sharey=True, width_ratios=[3, 1.3])
    rows = np.arange(len(names))
    places.hlines(rows, 0, 1, color=GREY, lw=0.5, alpha=0.4, zorder=0)
    ranks, marks = np.linspace(0, 1, len(tried)), {"cmap": "cividis", "s": 16, "lw": 0}
    for row in rows:  # in reverse, so that the best are drawn on top
        values, heights = tried[::-1, row], np.full(len(tried), row)
        shown = places.scatter(values, heights, c=ranks, vmin=0, vmax=1, **marks)
    for start, end in itertools.pairwise([recipe, *incumbents]):
        places.plot(np.stack([start, end]), [rows, rows], color=ORANGE, lw=1.5, alpha=0.8)
    places.scatter(recipe, rows, marker="|", s=160, color="black", zorder=3, label="recipe")
    for last in incumbents[-1:]:
        places.scatter(last, rows, marker="*", s=120, color=ORANGE, zorder=4, label="incumbent")
    places.set_yticks(rows, names, fontsize="small")
    places.set_xlim(-0.03, 1.03)
    places.set_xticks([0, 1], ["lowest", "highest"])
    places.set_xlabel("value within the search space")
    figure.colorbar(shown, ax=places, ticks=[0, 1], pad=0.01).ax.set_yticklabels(["worst", "best"])
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=3)
    _plot_importance(bars, found)
    for axes in (places, bars):
        axes.spines[["top", "right"]].set_visible(False)
    places.invert_yaxis()
    places.set_title(title, fontsize="medium")
    return figure


def _plot_importance(axes: Axes, found: Importance | None) -> None:
    if found is not None and found.explained > 0:
        rows = np.arange(len(found.names))
        axes.barh(rows, found.mean, xerr=found.std, color=BLUE, height=0.6)
        axes.set_xlabel("importance (drop of R²)")
        title = (
            f"ranks of {found.results} results of {found.budget} core seconds;\n"
            f"R² of a forest on held-out ones: {found.explained:.2f}"
        )
    else:
        axes.set_xticks([])
        title = "no importance: too few results" if found is None else "no importance: R² below 0"
    axes.set_title(title, fontsize="x-small")
