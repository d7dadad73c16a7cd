"""Plots of an NES run."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from bilevel.nes import GenerationRecord
from bilevel.tasks import Task
from cluster.pictures import BLUE, GREY, ORANGE


def learning_curve(records: Sequence[GenerationRecord], task: Task, title: str) -> Figure:
    """Plot scores and train steps by generation, and mark the best generation.

    The records of several runs may follow one another.
    """
    generations = np.arange(len(records))
    starts = [i for i, record in enumerate(records) if i and record.generation == 0]
    mean = np.array([record.score_mean for record in records])
    std = np.array([record.score_std for record in records])
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    scores, steps = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    scores.fill_between(generations, mean - std, mean + std, color=BLUE, alpha=0.15, lw=0)
    label = "agents trained on the current SE (mean, std)"
    scores.plot(generations, mean, color=BLUE, marker="o", ms=3, label=label)
    perturbed = [record.perturbed_score_mean for record in records]
    label = "agents trained on perturbed SEs (mean)"
    scores.plot(generations, perturbed, color=GREY, lw=1, label=label)
    scores.axhline(task.solved_reward, color=ORANGE, ls="--", lw=1, label="solved")
    best = int(np.argmax(mean))
    label = f"best: {mean[best]:.1f} in generation {best}"
    scores.plot(best, mean[best], "*", ms=11, color="black", label=label)
    scores.set_ylabel(f"test return on {task.id}")
    scores.set_title(title)
    scores.legend(frameon=False, fontsize="small")
    steps.plot(generations, [record.train_steps_mean for record in records], color=BLUE)
    steps.set_ylabel("train steps")
    steps.set_xlabel("generation" if not starts else "generations of all runs")
    steps.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    steps.set_ylim(bottom=0)
    for axes in (scores, steps):
        for first in starts:
            axes.axvline(first - 0.5, color=GREY, lw=0.8, ls=":")
        axes.spines[["top", "right"]].set_visible(False)
    return figure
