"""Style of the experiments' pictures: vector graphics as wide as one column of the paper."""

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cluster.experiments.conditions import title_of
from cluster.pictures import image

#: Colours of sources and conditions, which also differ in grey.
COLOURS = {
    "real": "#2b2b2b",
    "default": "#e0622a",
    "varied": "#1f4e9c",
    "fixed": "#8db9e0",
    "authors": "#1f4e9c",
    "paper": "#7cc4c6",
}

#: Colours of other series, in order.
SERIES = ("#1f4e9c", "#e0872e", "#a5d3b6", "#6e6e6e")

_STYLE: dict[Any, Any] = {
    "font.size": 7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "svg.hashsalt": "bilevel",  # equal pictures have equal files
}


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Apply the style to figures that are made within the block."""
    with mpl.rc_context(_STYLE):
        yield


def column(height: float) -> Figure:
    """Return a figure of the width of a column of the paper and that height, in inches."""
    return Figure(figsize=(3.4, height), layout="constrained")


def panels(number: int, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    """Return a figure with `number` axes in two columns, each of that height in inches."""
    rows = -(-number // 2)
    figure = column(0.5 + height * rows)
    axes = [*figure.subplots(rows, 2, squeeze=False, **options).flat]
    for unused in axes[number:]:
        unused.set_visible(False)
    return figure, axes[:number]


def line_chart(curves: Mapping[str, tuple[Any, Any]], **labels: Any) -> Figure:
    """Draw a line of x and y per source; `labels` are arguments of `Axes.set`."""
    figure = column(2.5)
    axes = figure.subplots()
    for name, (x, y) in curves.items():
        axes.plot(x, y, color=COLOURS[name], label=title_of(name))
    axes.set(**labels)
    axes.legend()
    return figure


def solved_line(axes: Axes, solved_reward: float) -> None:
    """Mark the return at which the task is solved by a dotted line."""
    axes.axhline(solved_reward, color="#404040", lw=0.7, ls=":", zorder=0)


def svg(figure: Figure) -> bytes:
    """Return the content of the figure's SVG file, which depends only on the figure."""
    with styled():
        return image(figure, "svg", metadata={"Date": None})
