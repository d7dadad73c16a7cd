"""The pictures that go to MLflow."""

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from bilevel.nes import GenerationRecord
from bilevel.tasks import Task
from cluster.bohb.summary import ResultPoint

_BLUE, _ORANGE, _GREY = "#2a6fbb", "#d9822b", "#8a8f98"


def png(figure: Figure) -> bytes:
    """A picture as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()


def learning_curve(records: Sequence[GenerationRecord], task: Task, title: str) -> Figure:
    """Scores and train steps by generation."""
    generations = [record.generation for record in records]
    mean = np.array([record.score_mean for record in records])
    std = np.array([record.score_std for record in records])
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    scores, steps = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    scores.fill_between(generations, mean - std, mean + std, color=_BLUE, alpha=0.15, lw=0)
    scores.plot(generations, mean, color=_BLUE, marker="o", ms=3, label="agents on psi (mean, std)")
    perturbed = [record.perturbed_score_mean for record in records]
    scores.plot(generations, perturbed, color=_GREY, lw=1, label="agents on psi ± eps (mean)")
    scores.axhline(task.solved_reward, color=_ORANGE, ls="--", lw=1, label="solved")
    scores.set_ylabel(f"test return on {task.id}")
    scores.set_title(title)
    scores.legend(frameon=False, fontsize="small")
    steps.plot(generations, [record.train_steps_mean for record in records], color=_BLUE)
    steps.set_ylabel("train steps")
    steps.set_xlabel("generation")
    steps.set_ylim(bottom=0)
    for axes in (scores, steps):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def objective_against_cost(points: Sequence[ResultPoint], task: Task, title: str) -> Figure:
    """Every result over what the search had spent, and the incumbent at the largest
    budget seen so far."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for model_based, marker, colour in ((False, "o", _GREY), (True, "D", _BLUE)):
        chosen = [point for point in points if point.model_based is model_based]
        if not chosen:
            continue
        axes.scatter(
            [point.generations_spent for point in chosen],
            [point.objective for point in chosen],
            s=[14 + 6 * point.budget for point in chosen],
            marker=marker,
            color=colour,
            alpha=0.6,
            lw=0,
            label="model-based pick" if model_based else "random pick",
        )
    largest = max((point.budget for point in points), default=0)
    top = [point for point in points if point.budget == largest]
    if top:
        best = np.maximum.accumulate([point.objective for point in top])
        spent = [point.generations_spent for point in top]
        axes.step(
            spent, best, where="post", color=_ORANGE, label=f"incumbent, {largest} generations"
        )
    axes.set_xlabel("generations spent by the search (marker size: budget of the result)")
    axes.set_ylabel("objective (mean score over the generations)")
    axes.set_title(f"{title}, {task.id}")
    axes.legend(frameon=False, fontsize="small")
    axes.spines[["top", "right"]].set_visible(False)
    return figure
