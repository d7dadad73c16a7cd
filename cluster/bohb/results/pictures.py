"""Pictures of a study."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bilevel.tasks import Task
from cluster.bohb.results.importance import Importance
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.journal import Origin
from cluster.pictures import BLUE, GREY, ORANGE

Floats = NDArray[np.float64]


def objective_against_cost(summary: StudySummary, task: Task, title: str) -> Figure:
    """Plot every result over the core seconds spent until then, the best one at the largest budget
    so far, and the finalists over new seeds."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel("core seconds spent by the search (marker size: budget of the result)")
    axes.set_ylabel("objective: core seconds per SE")
    axes.set_yscale("log")
    axes.set_title(f"{title}, {task.id}")
    axes.spines[["top", "right"]].set_visible(False)
    points, proposals = summary.points(), summary.journal.proposals
    if not points:
        return figure
    budgets = {line.budget for _, line in points}
    for model_based, colour, label in ((False, GREY, "other results"), (True, BLUE, Origin.MODEL)):
        chosen = [
            (spent, line)
            for spent, line in points
            if (proposals[line.id].origin is Origin.MODEL) is model_based
        ]
        axes.scatter(
            [spent for spent, _ in chosen],
            [line.objective for _, line in chosen],
            s=[16 * line.budget / min(budgets) for _, line in chosen],
            color=colour,
            alpha=0.6,
            lw=0,
            label=label,
        )
    ranked = [(spent, line.objective) for spent, line in points if line.budget == max(budgets)]
    best = np.minimum.accumulate([objective for _, objective in ranked])
    label = f"best so far after {max(budgets)} core seconds: {best[-1]:.0f}"
    axes.step([spent for spent, _ in ranked], best, where="post", color=ORANGE, label=label)
    objectives = [line.objective for line in summary.finalists]
    if objectives:
        spent = points[-1][0] + sum(line.budget for line in summary.finalists)
        label = f"finalists, new seeds: {', '.join(f'{y:.0f}' for y in objectives)}"
        colours = [ORANGE, *["black"] * (len(objectives) - 1)]
        places = [spent] * len(objectives)
        axes.scatter(places, objectives, marker="*", s=120, c=colours, zorder=3, label=label)
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=2)
    return figure


def hyperparameters(
    tried: Floats,
    incumbent: Floats,
    recipe: Floats,
    names: Sequence[str],
    found: Importance | None,
    title: str,
) -> Figure:
    """Plot d hyperparameters: the values of all configurations, of the recipe and of the incumbent,
    and the importance of each.

    `tried` (n, d), the best first, `incumbent` (d,) and `recipe` (d,) are scaled to [0, 1] over
    the search space, with NaN outside. Colours are ranks.
    """
    figure = Figure(figsize=(9, 1.6 + 0.42 * len(names)), layout="constrained")
    places, bars = figure.subplots(1, 2, sharey=True, width_ratios=[3, 1.3])
    rows = np.arange(len(names))
    n, worst_first = len(tried), tried[::-1]  # so that the best are drawn on top
    ranks = np.repeat(np.linspace(0, 1, n), len(names))
    heights = np.tile(rows, n)
    shown = places.scatter(worst_first.ravel(), heights, s=16, c=ranks, cmap="cividis", lw=0)
    shown.set_clim(0, 1)
    places.scatter(recipe, rows, marker="|", s=160, color="black", zorder=3, label="recipe")
    places.scatter(incumbent, rows, marker="*", s=120, color=ORANGE, zorder=4, label="incumbent")
    places.set_yticks(rows, names, fontsize="small")
    places.set_xlim(-0.03, 1.03)
    places.set_xticks([0, 1], ["lowest", "highest"])
    places.set_xlabel("value within the search space")
    figure.colorbar(shown, ax=places, ticks=[0, 1], pad=0.01).ax.set_yticklabels(["worst", "best"])
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=2)
    bars.set_xlabel("importance (drop of R²)")
    if found is None:
        bars.set_title("too few results for importances", fontsize="x-small")
    else:
        bars.barh(rows, found.mean, xerr=found.std, color=BLUE, height=0.6)
        basis = f"{found.results} results of {found.budget} core s, R² {found.explained:.2f}"
        bars.set_title(basis, fontsize="x-small")
    places.invert_yaxis()
    places.set_title(title, fontsize="medium")
    return figure
