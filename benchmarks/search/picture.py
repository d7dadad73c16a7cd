"""The pictures of searches in docs/search.md, from the committed results.

python -m benchmarks.search.picture
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from benchmarks.machine import read_result
from benchmarks.pictures import digest, grid, save, steps_and_scores
from benchmarks.search.tables import TASKS, by_method, by_start, first_results, incumbents
from cluster.profiles import METHODS
from cluster.progress import count
from search_spaces import search_space

PICTURE = Path(__file__).parents[2] / "docs" / "search.svg"
EFFECTS = PICTURE.with_name("search_space.svg")

_COLOURS = {"bohb": "#2a6fbb", "hyperband": "#3d9970", "random": "#d9822b"}


def _studies(task: str) -> list[dict[str, Any]]:
    studies: list[dict[str, Any]] = read_result(f"search_{task}", "studies")["studies"]
    return studies


def _incumbents(axes: Axes, task: str) -> None:
    """Best objective at the largest budget so far: every study, and each method's median from
    where all its studies have one."""
    groups = by_method({"studies": _studies(task)})
    ends = [study["results"][-1]["minutes"] for study in _studies(task)]
    minutes = np.linspace(0, max(ends), 300)
    for method, studies in groups.items():
        curves = []
        for study in studies:
            curve = np.full(minutes.size, np.nan)
            for when, objective in incumbents(study):
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
    found: dict[tuple[int, str, bool], list[float]] = {}
    for method, studies in by_method({"studies": _studies(task)}).items():
        for line in (line for study in studies for line in first_results(study)):
            column = (line["budget"], method, line["model_based"])
            found.setdefault(column, []).append(line["objective"])
    columns = sorted(found, key=lambda column: column[0])  # methods stay in their order
    rng = np.random.default_rng(0)
    for place, column in enumerate(columns):
        values = found[column]
        across = place + rng.uniform(-0.18, 0.18, len(values))
        axes.scatter(across, values, color=_COLOURS[column[1]], s=12, alpha=0.5)
        axes.hlines(np.median(values), place - 0.3, place + 0.3, color="black", lw=1.5)
    axes.set_ylim(*_most_of([value for values in found.values() for value in values]))
    names = [
        f"{METHODS[method]}, {'model' if by_model else 'random'},\n{count(budget, 'generation')}"
        for budget, method, by_model in columns
    ]
    axes.set_xticks(range(len(names)), names, fontsize=7, rotation=30, ha="right")
    axes.set_ylabel("objective")
    axes.set_title(f"{task}: first results by proposer, and their median")


def _best(axes: Axes, task: str) -> None:
    """Fresh agents, a point the SE that a study hands over."""
    groups = {
        METHODS[method]: (_COLOURS[method], [study["own"] for study in studies])
        for method, studies in by_method({"studies": _studies(task)}).items()
    }
    steps_and_scores(axes, task, groups)
    axes.set_title(f"{task}: fresh agents on the best SEs")


def _effect(name: str, axes: Axes, task: str) -> None:
    """Mean fitness of a run's first generations, less the median of all runs from its start,
    against one of its hyperparameters; the median of each fifth of the runs."""
    values, gains = [], []
    for runs in by_start(_studies(task)).values():
        generations = min(len(run["fitness"]) for run in runs)
        fitness = [np.mean(run["fitness"][:generations]) for run in runs]
        gains += list(fitness - np.median(fitness))
        values += [run["values"][name] for run in runs]
    axes.scatter(values, gains, color="#7a7a7a", s=9, alpha=0.4)
    order = np.argsort(values)
    for fifth in np.array_split(order, 5):
        part = np.array(values)[fifth]
        axes.hlines(np.median(np.array(gains)[fifth]), part.min(), part.max(), "#2a6fbb", lw=2)
    axes.set_ylim(*_most_of(gains))
    dimension: Any = search_space("core")[name]
    axes.set_xscale("log" if dimension.log else "linear")
    spaced = np.geomspace if dimension.log else np.linspace
    ticks = spaced(dimension.lower, dimension.upper, 3)
    axes.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel(name)
    axes.set_ylabel("fitness, less the median of the start")


def _most_of(values: Sequence[float]) -> tuple[float, float]:
    """Limits of an axis; of the worst, which are far below, one in twenty lies outside."""
    low, high = float(np.quantile(values, 0.05)), max(values)
    margin = 0.05 * (high - low)
    return low - margin, high + margin


def picture() -> Figure:
    """What searches find."""
    return grid(TASKS, (_incumbents, _proposals, _best))


def effects() -> Figure:
    """What the hyperparameters do."""
    panels = [partial(_effect, name) for name in search_space("core")]
    return grid(TASKS, panels, width=3.0)


def results_digest() -> str:
    """Of what the picture shows."""
    return digest([_studies(task) for task in TASKS])


def main() -> None:
    """Write `docs/search.svg` and `docs/search_space.svg`."""
    save(picture(), PICTURE, results_digest())
    save(effects(), EFFECTS, results_digest())


if __name__ == "__main__":
    main()
