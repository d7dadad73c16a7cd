"""The picture of docs/nes.md, from the committed results.

python -m benchmarks.nes_picture
"""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.machine import read_result
from benchmarks.nes_tables import TASKS
from benchmarks.pictures import digest, save
from bilevel.tasks import get_task

PICTURE = Path(__file__).parents[1] / "docs" / "nes.svg"

_COLOURS = ("#2a6fbb", "#3d9970", "#d9822b", "#8a8f98", "#b04a8b", "#7f6bb0", "#c0504d", "#555555")


def _variants(task: str) -> dict[str, list[dict[str, Any]]]:
    found = read_result(f"nes_{task}")["variants"]
    return {name: variant["runs"] for name, variant in found.items()}


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
    axes.set_xlabel("generation")
    axes.set_ylabel("score of psi")
    axes.set_title(f"{task}: {len(runs)} seed(s), and their median")


def _solved(axes: Axes, task: str) -> None:
    """Share of the seeds that have solved the task by a generation, of every variant."""
    for (name, runs), colour in zip(_variants(task).items(), _COLOURS, strict=False):
        firsts = [run["first_solved_generation"] for run in runs]
        longest = max(run["generations"] for run in runs)
        share = [np.mean([f is not None and f <= g for f in firsts]) for g in range(longest + 1)]
        axes.step(
            range(longest + 1), share, color=colour, where="post", label=f"{name} ({len(runs)})"
        )
    axes.set_ylim(0, 1.03)
    axes.yaxis.set_major_formatter(mpl.ticker.PercentFormatter(1.0))
    axes.set_xlabel("generation")
    axes.set_ylabel("seeds that have solved the task")
    axes.set_title(f"{task}: variants (seeds)")
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def _trade_off(axes: Axes, task: str) -> None:
    """Score against train steps of varied agents on the best SE of each run."""
    for (name, runs), colour in zip(_variants(task).items(), _COLOURS, strict=False):
        measured = [run["varied"]["ddqn"] for run in runs if "ddqn" in run["varied"]]
        if measured:
            steps = [agents["train_steps_mean"] for agents in measured]
            scores = [agents["score_mean"] for agents in measured]
            axes.scatter(steps, scores, color=colour, s=22, alpha=0.8, label=name)
    axes.axhline(get_task(task).solved_reward, color="black", lw=0.8, ls=":")
    axes.set_xlabel("train steps (mean of 20 agents)")
    axes.set_ylabel("test return (mean)")
    axes.set_title(f"{task}: varied DDQN on the best SEs")
    if axes.collections:
        axes.legend(frameon=False, fontsize=8)
    else:
        axes.text(0.5, 0.5, "not measured yet", ha="center", transform=axes.transAxes)


def picture() -> Figure:
    """A row a task."""
    figure = Figure(figsize=(15, 4.4 * len(TASKS)), layout="constrained")
    for row, task in zip(figure.subplots(len(TASKS), 3), TASKS, strict=True):
        for draw, axes in zip((_curves, _solved, _trade_off), row, strict=True):
            draw(axes, task)
            axes.spines[["top", "right"]].set_visible(False)
    return figure


def results_digest() -> str:
    """Of what the picture shows."""
    return digest([_variants(task) for task in TASKS])


def main() -> None:
    """Write `docs/nes.svg`."""
    save(picture(), PICTURE, results_digest())


if __name__ == "__main__":
    main()
