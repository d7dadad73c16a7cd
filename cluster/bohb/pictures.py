"""Plots of a study."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from bilevel.tasks import Task
from cluster.bohb.summary import ResultPoint
from cluster.tracking.pictures import BLUE, GREY, ORANGE


def objective_against_cost(points: Sequence[ResultPoint], task: Task, title: str) -> Figure:
    """Plot every result over the generations spent by then, and the incumbent at the largest
    budget so far."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for model_based, marker, colour in ((False, "o", GREY), (True, "D", BLUE)):
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
            spent, best, where="post", color=ORANGE, label=f"incumbent, {largest} generations"
        )
    axes.set_xlabel("generations spent by the search (marker size: budget of the result)")
    axes.set_ylabel("objective (mean score over the generations)")
    axes.set_title(f"{title}, {task.id}")
    axes.legend(frameon=False, fontsize="small")
    axes.spines[["top", "right"]].set_visible(False)
    return figure
