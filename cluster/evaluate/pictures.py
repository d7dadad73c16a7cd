"""The picture of an evaluation of many agents."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import t as student_t

from bilevel.tasks import Task
from cluster.evaluate.report import Group
from cluster.pictures import BLUE, GREY, ORANGE

_COLOURS = (BLUE, ORANGE, "#3d9970", GREY, "#b04a8b")

#: Number of agents from which a violin shows their distribution; of fewer it would invent one.
VIOLIN_FROM = 20


def returns(groups: Sequence[Group], task: Task, title: str) -> Figure:
    """Plot every agent's score and, below, its train steps, by group: a point an agent, the mean
    with its 95 % interval and, where there are VIOLIN_FROM agents or more, a violin (as in the
    paper's figures on robustness and transfer)."""
    figure = Figure(figsize=(max(5.0, 1.9 * len(groups) + 1.5), 6), layout="constrained")
    scores, steps = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.4])
    kinds = sorted({group.agent for group in groups})
    for x, group in enumerate(groups):
        colour = _COLOURS[kinds.index(group.agent) % len(_COLOURS)]
        for axes, values in ((scores, group.scores), (steps, group.train_steps)):
            _column(axes, x, values, colour)
            _above(axes, x, f"{values.mean():.1f}" if axes is scores else f"{values.mean():.0f}")
    scores.axhline(task.solved_reward, color=ORANGE, ls="--", lw=1, label="solved")
    scores.set_ylabel(f"mean test return on {task.id}")
    figure.supxlabel("a point an agent; black: their mean and its 95 % interval", fontsize="small")
    scores.legend(frameon=False, fontsize="small", loc="lower left")
    scores.set_title(title, pad=18, wrap=True)  # above the means
    steps.set_ylabel("train steps")
    steps.set_ylim(bottom=0)
    labels = [f"{g.agent}\non {g.source}\nn = {len(g.results)}" for g in groups]
    steps.set_xticks(range(len(groups)), labels, fontsize="small")
    steps.set_xlim(-0.6, len(groups) - 0.4)
    for axes in (scores, steps):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _column(axes: Axes, x: int, values: NDArray[np.float64], colour: str) -> None:
    """Draw the values (n,) of one group at `x`."""
    if len(values) >= VIOLIN_FROM and np.ptp(values) > 0:
        parts: Any = axes.violinplot(values, [x], widths=0.85, showextrema=False)
        parts["bodies"][0].set(facecolor=colour, alpha=0.3)
    # Spread evenly in the order of the agents, so that the picture is always the same.
    beside = np.linspace(-0.18, 0.18, len(values)) if len(values) > 1 else np.zeros(1)
    axes.scatter(x + beside, values, s=14, color=colour, alpha=0.6, lw=0)
    error = 0.0
    if len(values) > 1:
        quantile = float(student_t.ppf(0.975, len(values) - 1))
        error = quantile * float(values.std(ddof=1)) / math.sqrt(len(values))
    axes.errorbar([x], [values.mean()], yerr=error, fmt="D", ms=5, color="black", capsize=4)


def _above(axes: Axes, x: int, text: str) -> None:
    axes.annotate(
        text,
        (x, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
        fontsize="small",
    )
