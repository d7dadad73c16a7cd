"""The picture of searches in README.md, from the committed results.

python -m benchmarks.search.picture
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.machine import read_result
from benchmarks.pictures import digest, grid, save, steps_and_scores
from benchmarks.search.tables import TASKS, by_method
from cluster.profiles import METHODS
from cluster.progress import count

PICTURE = Path(__file__).parents[2] / "docs" / "search.svg"

_COLOURS = {"bohb": "#2a6fbb", "hyperband": "#3d9970", "random": "#d9822b"}


def _studies(task: str) -> list[dict[str, Any]]:
    studies: list[dict[str, Any]] = read_result(f"search_{task}", "studies")["studies"]
    return studies


def _incumbents(axes: Axes, task: str) -> None:
    """Best objective at the largest budget so far: every study, and each method's median from
    where all its studies have one."""
    groups = by_method({"studies": _studies(task)})
    ends = [study["incumbents"][-1][0] for study in _studies(task) if study["incumbents"]]
    minutes = np.linspace(0, max(ends), 300)
    for method, studies in groups.items():
        curves = []
        for study in studies:
            curve = np.full(minutes.size, np.nan)
            for when, objective in study["incumbents"]:
                curve[minutes >= when] = objective
            curves.append(curve)
            axes.plot(minutes, curve, color=_COLOURS[method], alpha=0.35, lw=0.9)
        label = f"{METHODS[method]} ({len(studies)} studies)"
        axes.plot(minutes, np.median(curves, axis=0), color=_COLOURS[method], lw=2.2, label=label)
    axes.set_xlabel("minutes")
    axes.set_ylabel("best objective at the largest budget")
    axes.set_title(f"{task}: incumbents, and their median")
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def _proposals(axes: Axes, task: str) -> None:
    """The first result of every configuration, before any was promoted, by the budget it began
    with and by who proposed it."""
    groups = by_method({"studies": _studies(task)})
    columns = [
        (f"{METHODS[method]}, {kind},\n{count(int(budget), 'generation')}", method, values)
        for budget in sorted({b for s in _studies(task) for b in s["first_objectives"]}, key=int)
        for method, studies in groups.items()
        for kind in ("random", "model")
        if (values := _first(studies, budget, kind))
    ]
    rng = np.random.default_rng(0)
    for place, (_, method, values) in enumerate(columns):
        across = place + rng.uniform(-0.18, 0.18, len(values))
        axes.scatter(across, values, color=_COLOURS[method], s=12, alpha=0.5)
        axes.hlines(np.median(values), place - 0.3, place + 0.3, color="black", lw=1.5)
    names = [name for name, *_ in columns]
    axes.set_xticks(range(len(columns)), names, fontsize=7, rotation=30, ha="right")
    axes.set_ylabel("objective")
    axes.set_title(f"{task}: first results by proposer, and their median")


def _first(studies: list[dict[str, Any]], budget: str, kind: str) -> list[float]:
    found = [study["first_objectives"].get(budget, {}).get(kind, []) for study in studies]
    return [value for values in found for value in values]


def _best(axes: Axes, task: str) -> None:
    """Fresh agents, a point the SE that a study hands over."""
    groups = {
        METHODS[method]: (_COLOURS[method], [study["own"] for study in studies])
        for method, studies in by_method({"studies": _studies(task)}).items()
    }
    steps_and_scores(axes, task, groups)
    axes.set_title(f"{task}: fresh agents on the best SEs")


def picture() -> Figure:
    """What searches find."""
    return grid(TASKS, (_incumbents, _proposals, _best))


def results_digest() -> str:
    """Of what the picture shows."""
    return digest([_studies(task) for task in TASKS])


def main() -> None:
    """Write `docs/search.svg`."""
    save(picture(), PICTURE, results_digest())


if __name__ == "__main__":
    main()
