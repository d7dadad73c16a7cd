"""Pictures of the docs: written alike from the same results, and known by them."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bilevel.tasks import get_task

#: Draws a task's results.
Panel = Callable[[Axes, str], None]


def grid(tasks: Sequence[str], panels: Sequence[Panel], width: float = 5.0) -> Figure:
    """A row a task, a column a panel, each so many inches wide."""
    figure = Figure(figsize=(width * len(panels), 4.4 * len(tasks)), layout="constrained")
    rows = figure.subplots(len(tasks), len(panels), squeeze=False)
    for row, task in zip(rows, tasks, strict=True):
        for draw, axes in zip(panels, row, strict=True):
            draw(axes, task)
            axes.spines[["top", "right"]].set_visible(False)
    return figure


def steps_and_scores(
    axes: Axes, task: str, groups: Mapping[str, tuple[str, Sequence[Mapping[str, Any]]]]
) -> None:
    """Test return against train steps, a point an SE: of every group, by its name, a colour and
    what the agents on each of its SEs learned."""
    for name, (colour, learned) in groups.items():
        steps = [one["train_steps_mean"] for one in learned]
        scores = [one["score_mean"] for one in learned]
        axes.scatter(steps, scores, color=colour, s=24, alpha=0.75, label=name)
    axes.axhline(get_task(task).solved_reward, color="black", lw=0.8, ls=":")
    axes.set_xlabel("train steps (mean of the agents)")
    axes.set_ylabel("test return (mean of the agents)")
    axes.legend(frameon=False, fontsize=8)


def digest(results: Any) -> str:
    """Of the results that a picture shows; it stands in the picture's description, so
    that a picture of older results is noticed."""
    return hashlib.sha256(json.dumps(results, sort_keys=True).encode()).hexdigest()


def save(figure: Figure, path: Path, results_digest: str) -> None:
    """Write an SVG that is the same whenever it is made of the same."""
    with mpl.rc_context({"svg.hashsalt": path.stem}):
        metadata = {"Date": None, "Description": f"results {results_digest}"}
        figure.savefig(path, metadata=metadata)
    print(f"written to {path}")
