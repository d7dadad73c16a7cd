"""Plots of a study."""

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator
from numpy.typing import NDArray

from bilevel.tasks import Task
from cluster.bohb.results.importance import Importance
from cluster.bohb.results.summary import ResultPoint, ValidatedPoint
from cluster.bohb.study.journal import Origin
from cluster.pictures import BLUE, GREY, ORANGE

#: Seconds up to which a search is told in seconds.
_SHORT = 180.0
#: Part of the axis of time that labels are apart at least.
_APART = 0.05


def objective_against_cost(
    points: Sequence[ResultPoint], validated: Sequence[ValidatedPoint], task: Task, title: str
) -> Figure:
    """Plot every result over the core seconds, and the minutes, spent by then, the best at the
    largest budget so far, and what became of the finalists over new seeds, the winner first."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel("core seconds spent by the search (marker size: budget of the result)")
    axes.set_ylabel("objective: core seconds per SE")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_title(f"{title}, {task.id}")
    axes.spines["right"].set_visible(False)
    if not points:
        return figure
    smallest = min(point.budget for point in points)
    for model_based, marker, colour in ((False, "o", GREY), (True, "D", BLUE)):
        chosen = [point for point in points if (point.origin is Origin.MODEL) is model_based]
        if chosen:
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
    _mark_leader(axes, points)
    _mark_finalists(axes, validated)
    _add_time(axes, points)
    ends = [point.spent for point in points] + [point.spent for point in validated]
    axes.set_xlim(0, 1.03 * max(ends))
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=2)
    return figure


def _mark_leader(axes: Axes, points: Sequence[ResultPoint]) -> None:
    """The best result at the largest budget so far."""
    largest = max(point.budget for point in points)
    ranked = [point for point in points if point.budget == largest]
    spent = [point.spent for point in ranked]
    best = np.minimum.accumulate([point.objective for point in ranked])
    label = f"best so far after {largest} core seconds: {best[-1]:.0f}"
    axes.step(spent, best, where="post", color=ORANGE, label=label)


def _mark_finalists(axes: Axes, validated: Sequence[ValidatedPoint]) -> None:
    """A line from each finalist's result in the search to that over new seeds; a star is the
    incumbent's."""
    for point in validated:
        xs, ys = (point.searched.spent, point.spent), (point.searched.objective, point.objective)
        axes.plot(xs, ys, color="black", ls=":", lw=0.9, zorder=2)
    for chosen, marker, size, colour, label in (
        (validated[:1], "*", 160, ORANGE, "incumbent, new seeds"),
        (validated[1:], "X", 50, "black", "other finalists, new seeds"),
    ):
        if chosen:
            axes.scatter(
                [point.spent for point in chosen],
                [point.objective for point in chosen],
                marker=marker,
                s=size,
                color=colour,
                zorder=4 if marker == "*" else 3,
                label=f"{label}: {', '.join(f'{point.objective:.0f}' for point in chosen)}",
            )


def _add_time(axes: Axes, points: Sequence[ResultPoint]) -> None:
    """A second axis above: whole minutes, or seconds, since the search began."""
    spent = [0.0, *(float(point.spent) for point in points)]
    seconds = [0.0, *(point.seconds for point in points)]
    unit, size = ("seconds", 1.0) if seconds[-1] < _SHORT else ("minutes", 60.0)
    times = np.asarray(MaxNLocator(6, integer=True).tick_values(0, seconds[-1] / size))
    times = times[(times >= 0) & (times * size <= seconds[-1])]
    ticks: list[tuple[float, str]] = []
    for time in times:  # but for those that a pause of the search would print over each other
        place = float(np.interp(time * size, seconds, spent))
        if not ticks or place - ticks[-1][0] > _APART * spent[-1]:
            ticks.append((place, f"{time:.0f}"))
    above = axes.secondary_xaxis("top")
    above.set_xticks([place for place, _ in ticks], [label for _, label in ticks])
    above.set_xlabel(f"{unit} since the search began")


def hyperparameters(
    tried: NDArray[np.float64],
    incumbents: NDArray[np.float64],
    recipe: NDArray[np.float64],
    names: Sequence[str],
    found: Importance | None,
    title: str,
) -> Figure:
    """Plot d hyperparameters: the values that were tried, the way from the recipe's to the
    incumbent's, and the importance of each.

    `tried` (n, d), the best first, `incumbents` (m, d) and `recipe` (d,) are on [0, 1] over the
    search space; NaN is out of it. Colours are the ranks of what was tried.
    """
    figure = Figure(figsize=(9, 1.6 + 0.42 * len(names)), layout="constrained")
    places, bars = figure.subplots(1, 2, sharey=True, width_ratios=[3, 1.3])
    rows = np.arange(len(names))
    backwards = tried[::-1]  # the best are drawn last, above the others
    ranks = np.linspace(0, 1, len(tried))
    for row in rows:
        places.axhline(row, color=GREY, lw=0.5, alpha=0.4, zorder=0)
        shown = places.scatter(
            backwards[:, row],
            np.full(len(tried), row),
            c=ranks,
            cmap="cividis",
            vmin=0,
            vmax=1,
            s=16,
            lw=0,
        )
    for step, (before, after) in enumerate(itertools.pairwise([recipe, *incumbents])):
        for row in rows:
            label = "the best so far, one after the other" if step == row == 0 else None
            xs = before[row], after[row]
            places.plot(xs, (row, row), color=ORANGE, lw=1.5, alpha=0.8, label=label)
    places.scatter(recipe, rows, marker="|", s=160, color="black", zorder=3, label="recipe")
    if len(incumbents):
        places.scatter(
            incumbents[-1], rows, marker="*", s=120, color=ORANGE, zorder=4, label="incumbent"
        )
    places.set_yticks(rows, names, fontsize="small")
    places.set_xlim(-0.03, 1.03)
    places.set_xticks([0, 1], ["lowest", "highest"])
    places.set_xlabel("value within the search space")
    figure.colorbar(shown, ax=places, ticks=[0, 1], pad=0.01).ax.set_yticklabels(["worst", "best"])
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=3)
    if found is None:
        told = "too few results to tell importance"
    else:
        told = (
            f"ranks of {found.results} results of {found.budget} core seconds;\n"
            f"R² of a forest on unseen ones: {found.explained:.2f}"
        )
    if found is not None and found.explained > 0:
        bars.barh(rows, found.mean, xerr=found.std, color=BLUE, height=0.6)
        bars.set_xlabel("importance (drop of R²)")
    else:
        told += "" if found is None else ",\nwhich tells nothing of importance"
        bars.set_xticks([])
    bars.set_title(told, fontsize="x-small")
    for axes in (places, bars):
        axes.spines[["top", "right"]].set_visible(False)
    places.invert_yaxis()
    places.set_title(title, fontsize="medium")
    return figure
