"""Draw the pictures of docs/tuning.md: committed studies, and the comparison of search methods.

python -m benchmarks.search.pictures
"""

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from benchmarks.search.comparison import (
    COMPARISONS,
    by_method,
    comparisons,
    core_seconds_per_solved,
)
from benchmarks.search.studies import committed
from bilevel.tasks import get_task
from cluster.bohb.results.pictures import objective_against_cost
from cluster.bohb.study.profiles import METHODS
from cluster.experiments.style import SERIES, column, styled

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"

#: Names of the studies that are drawn.
STUDIES = "bohb-local-core-default-seed0", "default-episodes"


@styled()
def compared(title: str, measured: dict[str, Any]) -> Figure:
    """Draw a point per search, a line per seed, and the median of each method."""
    figure = column(2.3)
    axes = figure.subplots()
    found = {method: by_method(measured, method) for method in METHODS}
    for seed in sorted(set.intersection(*map(set, found.values()))):
        costs = [core_seconds_per_solved(of[seed]) for of in found.values()]
        axes.plot(costs, color="#404040", lw=0.4, alpha=0.5, zorder=0)
    for x, (of, colour) in enumerate(zip(found.values(), SERIES, strict=False)):
        costs = [core_seconds_per_solved(fresh) for fresh in of.values()]
        axes.scatter([x] * len(costs), costs, s=14, color=colour)
        axes.hlines(float(np.median(costs)), x - 0.2, x + 0.2, color=colour, lw=2)
    default = core_seconds_per_solved(measured["default"]["fresh"])
    axes.axhline(default, color="#404040", lw=0.7, ls="--", label="the recipe exogenous")
    axes.legend(loc="lower right")
    axes.set_ylim(bottom=0)
    axes.set_xticks(range(len(METHODS)), [*METHODS.values()])
    axes.set_xlim(-0.5, len(METHODS) - 0.5)
    axes.set_ylabel("core seconds per solved run")
    axes.set_title(f"{title} (bars: medians)")
    return figure


def save_png(figure: Figure, path: Path, dpi: float) -> None:
    """Save a figure as a PNG of 96 colours, which is a tenth of the size of its SVG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    image = Image.open(buffer).convert("RGB")
    image = image.quantize(96, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    image.save(path, optimize=True)
    print(f"drawn: {path}")


def main() -> None:
    """Draw the studies and the comparisons."""
    for study in committed():
        folder = study.journal.folder
        if folder.name not in STUDIES:
            continue
        task = get_task(folder.parent.name)
        figure = objective_against_cost(study, task, METHODS["bohb"])
        save_png(figure, PICTURES / f"search-{task.id}-{folder.name}.png", dpi=100)
    for title, result in comparisons().items():
        name = COMPARISONS[title].replace("search_", "comparison-")
        save_png(compared(title, result["rows"]), PICTURES / f"{name}.png", dpi=200)


if __name__ == "__main__":
    main()
