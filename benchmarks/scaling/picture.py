"""The picture of docs/scaling.md, from the committed results.

python -m benchmarks.scaling.picture
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.pictures import digest, save
from benchmarks.scaling.generations import CORES, GENERATION, Cases, cases
from benchmarks.scaling.recorded import TASKS, load, recorded_run, varied_generations

PICTURE = Path(__file__).parents[2] / "docs" / "scaling.svg"

_COLOURS = {"CartPole-v0": "#2a6fbb", "Acrobot-v1": "#d9822b"}
_CLUSTERS = dict(zip(CORES, ("#b9c3cf", "#7f93ab", "#41658f", "#12345b"), strict=True))
_LINES = {"fixed agents": "-", "varied agents": ":"}
_TICKS = (2, 8, 16, 48, 256, 1024)


def _style(task: str, case: str) -> dict[str, Any]:
    agents, phase = case.split(", ")
    return {
        "color": _COLOURS[task],
        "ls": _LINES[agents],
        "alpha": 1.0 if phase == "late" else 0.5,
        "lw": 1.8,
        "label": f"{task.removesuffix('-v0').removesuffix('-v1')}, {case}",
    }


def _distributions(axes: Axes, found: dict[str, Cases]) -> None:
    for task, by_case in found.items():
        for case, generations in by_case.items():
            seconds = np.sort(np.concatenate([g.seconds for g in generations]))
            share = np.arange(1, seconds.size + 1) / seconds.size
            axes.plot(seconds, share, **_style(task, case))
    axes.set_xscale("log")
    axes.set_xlabel("seconds of an evaluation on its core")
    axes.set_ylabel("share of evaluations that took at most so long")
    axes.set_title("How long evaluations take")


def _efficiency(axes: Axes, result: dict[str, Any]) -> None:
    for task in TASKS:
        for case, rows in result["generations"][task]["by_cores"].items():
            cores = [row["cores"] for row in rows]
            axes.plot(cores, [row["efficiency"] for row in rows], **_style(task, case))
    axes.axvline(GENERATION, color="#8a8f98", lw=1, ls="--")
    axes.text(GENERATION * 1.1, 0.97, f"{GENERATION} evaluations", color="#5b6068", va="top")
    axes.set_xscale("log")
    axes.set_xticks(_TICKS, [str(c) for c in _TICKS])
    axes.minorticks_off()
    axes.set_ylim(0, 1)
    axes.set_xlabel("cores")
    axes.set_ylabel("efficiency: share of the cores' time in evaluations")
    axes.set_title("One generation of 16 members")


def _search(axes: Axes, result: dict[str, Any]) -> None:
    rows = result["search"]["splits"]
    for cores, colour in _CLUSTERS.items():
        own = [row for row in rows if row["cores"] == cores]
        workers = [row["workers_per_trial"] for row in own]
        hours = [row["hours"] for row in own]
        axes.plot(workers, hours, color=colour, marker="o", ms=4, lw=1.8)
        axes.annotate(
            f"{cores} cores",
            (workers[-1], hours[-1]),
            xytext=(6, 0),
            textcoords="offset points",
            color=colour,
            va="center",
        )
    ticks = sorted({row["workers_per_trial"] for row in rows})
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(ticks, [str(c) for c in ticks])
    axes.set_xlim(0.9, 130)
    hours_ticks = (0.5, 1, 2, 5, 10)
    axes.set_yticks(hours_ticks, [f"{h:g}" for h in hours_ticks])
    axes.minorticks_off()
    axes.set_xlabel("workers per trial (as many trials at a time as the cores hold)")
    axes.set_ylabel("hours")
    axes.set_title(f"A search: the paper profile on {result['search']['task']}")


def picture() -> Figure:
    """Distributions, efficiency of a generation, time of a search."""
    found = {task: cases(recorded_run(task), varied_generations(task)) for task in TASKS}
    result = load("simulated")
    figure = Figure(figsize=(15, 5.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _distributions(left, found)
    _efficiency(middle, result)
    _search(right, result)
    for axes in (left, middle, right):
        axes.spines[["top", "right"]].set_visible(False)
    lines = left.get_legend_handles_labels()
    figure.legend(*lines, frameon=False, loc="outside lower left", ncols=4)
    return figure


def results_digest() -> str:
    """Of what the picture shows."""
    names = ["simulated", *(f"{kind}_{task}" for kind in ("nes", "agents") for task in TASKS)]
    return digest([load(name) for name in names])


def main() -> None:
    """Write `docs/scaling.svg`."""
    save(picture(), PICTURE, results_digest())


if __name__ == "__main__":
    main()
