"""The picture of docs/nes.md, from the committed results.

python -m benchmarks.nes_picture
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from benchmarks.machine import NotMeasured, read_result
from benchmarks.nes_study import AGENTS
from benchmarks.nes_tables import TASKS
from benchmarks.pictures import digest, save
from bilevel.tasks import get_task

PICTURE = Path(__file__).parents[1] / "docs" / "nes.svg"

_COLOURS = ("#2a6fbb", "#3d9970", "#d9822b", "#8a8f98", "#b04a8b", "#7f6bb0", "#c0504d", "#555555")


def _variants(task: str) -> dict[str, list[dict[str, Any]]]:
    found = read_result(f"nes_{task}")["variants"]
    return {name: variant["runs"] for name, variant in found.items()}


def _limits(task: str) -> dict[str, list[dict[str, Any]]]:
    try:
        points: dict[str, list[dict[str, Any]]] = read_result(f"step_limits_{task}")["points"]
    except NotMeasured:
        return {}
    return points


def _curves(axes: Axes, task: str) -> None:
    """Every run of the defaults, and the median; a run that stopped keeps its last score."""
    runs = _variants(task)["defaults"]
    longest = max(run["generations"] for run in runs)
    curves = [run["score_curve"] for run in runs]
    filled = np.array([[*curve, *[curve[-1]] * (longest - len(curve))] for curve in curves])
    for curve in curves:
        axes.plot(curve, color=_COLOURS[0], alpha=0.3, lw=0.9)
    axes.plot(np.median(filled, axis=0), color=_COLOURS[0], lw=2.2)
    solved = get_task(task).solved_reward
    axes.axhline(solved, color="black", lw=0.8, ls=":")
    axes.annotate("solved", (longest, solved), ha="right", va="bottom", fontsize=8)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("generation")
    axes.set_ylabel("score of psi")
    axes.set_title(f"{task}: {len(runs)} seed(s), and their median")


def _step_limits(axes: Axes, task: str) -> None:
    """Train steps and test return at every step limit, a line an agent; means over SEs."""
    for (agent, points), colour in zip(_limits(task).items(), _COLOURS, strict=False):
        steps, scores = (
            [np.mean([se[field] for se in point["ses"]]) for point in points]
            for field in ("train_steps_mean", "score_mean")
        )
        axes.plot(steps, scores, "o-", color=colour, ms=4, lw=1.2, label=agent)
        if agent == AGENTS[-1]:  # the shares are those of all, in the same order
            for point, x, y in zip(points, steps, scores, strict=True):
                share, below = f"{point['share']:.0%}", (4, -9)
                axes.annotate(share, (x, y), below, textcoords="offset points", fontsize=8)
    axes.axhline(get_task(task).solved_reward, color="black", lw=0.8, ls=":")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:.0f}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("train steps (mean)")
    axes.set_ylabel("test return (mean)")
    axes.set_title(f"{task}: step limit of the SE, as a share of the task's")
    if axes.lines[1:]:
        axes.legend(frameon=False, fontsize=8, loc="lower right")
    else:
        axes.text(0.5, 0.5, "not measured yet", ha="center", transform=axes.transAxes)


def _agents(axes: Axes, task: str) -> None:
    """Test return against train steps of varied agents, a point a run's best SE."""
    runs = _variants(task)["defaults"]
    for agent, colour in zip(AGENTS, _COLOURS, strict=False):
        found = [run["varied"][agent] for run in runs if agent in run["varied"]]
        steps = [one["train_steps_mean"] for one in found]
        scores = [one["score_mean"] for one in found]
        if found:
            label = f"{agent} ({len(found)} SEs)"
            axes.scatter(steps, scores, color=colour, s=22, alpha=0.7, label=label)
    axes.axhline(get_task(task).solved_reward, color="black", lw=0.8, ls=":")
    axes.set_xlabel("train steps (mean of the agents)")
    axes.set_ylabel("test return (mean of the agents)")
    axes.set_title(f"{task}: varied agents on the best SEs")
    axes.legend(frameon=False, fontsize=8)


def picture() -> Figure:
    """A row a task."""
    figure = Figure(figsize=(15, 4.4 * len(TASKS)), layout="constrained")
    for row, task in zip(figure.subplots(len(TASKS), 3), TASKS, strict=True):
        for draw, axes in zip((_curves, _step_limits, _agents), row, strict=True):
            draw(axes, task)
            axes.spines[["top", "right"]].set_visible(False)
    return figure


def results_digest() -> str:
    """Of what the picture shows."""
    return digest([[_variants(task)["defaults"], _limits(task)] for task in TASKS])


def main() -> None:
    """Write `docs/nes.svg`."""
    save(picture(), PICTURE, results_digest())


if __name__ == "__main__":
    main()
