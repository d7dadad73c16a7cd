"""Picture of an evaluation."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import sem
from scipy.stats import t as student_t

from bilevel.tasks import Task
from cluster.evaluate.report import Group
from cluster.pictures import BLUE, GREY, ORANGE

_COLOURS = (BLUE, ORANGE, "#3d9970", GREY, "#b04a8b")

#: Number of agents from which a violin is drawn; it would suggest too much about fewer agents.
VIOLIN_FROM = 20


def returns(groups: Sequence[Group], task: Task, title: str) -> Figure:
    """Draw every agent's score and, below, its train steps by group, with the mean, its 95 %
    interval and, from VIOLIN_FROM agents on, a violin."""
    figure = Figure(figsize=(max(5.0, 1.9 * len(groups) + 1.5), 6), layout="constrained")
    scores, steps = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.4])
    kinds = sorted({group.agent for group in groups})
    labels = []
    for x, group in enumerate(groups):
        colour = _COLOURS[kinds.index(group.agent) % len(_COLOURS)]
        _draw(scores, x, group.scores, colour)
        _draw(steps, x, group.train_steps, colour)
        labels.append(
            f"{group.agent}\non {group.source}\nn = {len(group.results)}\n"
            f"score {group.scores.mean():.1f}\n{group.train_steps.mean():.0f} steps"
        )
    scores.axhline(task.solved_reward, color=ORANGE, ls="--", lw=1, label="solved")
    scores.set_ylabel(f"mean test return on {task.id}")
    scores.legend(frameon=False, fontsize="small", loc="lower left")
    scores.set_title(title, wrap=True)
    steps.set_ylabel("train steps")
    steps.set_ylim(bottom=0)
    steps.set_xticks(range(len(groups)), labels, fontsize="small")
    steps.set_xlim(-0.6, len(groups) - 0.4)
    figure.supxlabel("points: agents; black: their mean and its 95 % interval", fontsize="small")
    for axes in (scores, steps):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw(axes: Axes, x: int, values: NDArray[np.float64], colour: str) -> None:
    """Draw the values (n,) of one group at `x`."""
    n = len(values)
    if n >= VIOLIN_FROM and np.ptp(values) > 0:
        parts: Any = axes.violinplot(values, [x], widths=0.85, showextrema=False)
        parts["bodies"][0].set(facecolor=colour, alpha=0.3)
    # Spread in the order of the agents, so that equal results have equal pictures.
    offsets = np.linspace(-0.18, 0.18, n) if n > 1 else np.zeros(1)
    axes.scatter(x + offsets, values, s=14, color=colour, alpha=0.6, lw=0)
    error = float(student_t.ppf(0.975, n - 1) * sem(values)) if n > 1 else 0.0
    axes.errorbar([x], [values.mean()], yerr=error, fmt="D", ms=5, color="black", capsize=4)
