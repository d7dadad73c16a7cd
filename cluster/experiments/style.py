"""Style of the experiments' pictures: vector graphics as wide as one column of the paper.

Series differ in colour, lightness, and line, marker or hatch, so that grey prints are readable.
"""

import contextlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

#: Width in inches of a column of the paper.
COLUMN = 3.4

#: Colour of lines that mark a value.
GUIDE = "#404040"


@dataclass(frozen=True)
class Look:
    """Appearance of a series."""

    colour: str
    line: str
    marker: str
    hatch: str

    @property
    def curve(self) -> dict[str, Any]:
        """Arguments of `Axes.plot` and `Axes.errorbar`."""
        return {"color": self.colour, "ls": self.line, "marker": self.marker}


#: Looks by source or condition; series of one picture differ in lightness.
LOOKS = {
    "real": Look("#2b2b2b", "--", "s", ""),
    "default": Look("#e0622a", "-", "o", "//"),
    "varied": Look("#1f4e9c", "-.", "^", ".."),
    "fixed": Look("#8db9e0", ":", "v", "xx"),
    "authors": Look("#1f4e9c", "--", "^", ".."),
    "paper": Look("#7cc4c6", ":", "v", "xx"),
}

#: Looks of other series, in order.
SERIES = (
    Look("#1f4e9c", "-", "o", "//"),
    Look("#e0872e", "--", "s", ".."),
    Look("#a5d3b6", "-.", "^", "xx"),
    Look("#6e6e6e", ":", "v", ""),
)

_STYLE: dict[Any, Any] = {
    "font.size": 7.5,
    "axes.labelsize": 7.5,
    "axes.titlesize": 8,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 6.8,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 3.5,
    "hatch.linewidth": 0.4,
    "svg.hashsalt": "bilevel",  # equal pictures have equal files
}


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Apply the style to figures that are made within the block."""
    with mpl.rc_context(_STYLE):
        yield


def column(height: float) -> Figure:
    """Return a figure of one column's width and that height in inches."""
    return Figure(figsize=(COLUMN, height), layout="constrained")


def svg(figure: Figure) -> bytes:
    """Return the content of the figure's SVG file, which depends only on the figure."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def legend_below(axes: Axes) -> None:
    """Add a legend of the axes' series below its figure."""
    figure = axes.get_figure()
    assert isinstance(figure, Figure)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)


def panels(figure: Figure, number: int, **options: Any) -> list[Axes]:
    """Return `number` axes in two columns."""
    axes = [*figure.subplots(-(-number // 2), 2, squeeze=False, **options).flat]
    for unused in axes[number:]:
        unused.set_visible(False)
    return axes[:number]


def number(value: float, digits: str = "g") -> str:
    """Format a number with a minus sign instead of a hyphen."""
    return f"{value:{digits}}".replace("-", "\N{MINUS SIGN}")


def solved_line(axes: Axes, solved_reward: float) -> None:
    """Mark the return at which the task is solved by a labelled dotted line."""
    axes.axhline(solved_reward, color=GUIDE, lw=0.7, ls=(0, (1, 1.5)), zorder=0)
    axes.annotate(
        number(solved_reward),
        (1, solved_reward),
        xycoords=("axes fraction", "data"),
        xytext=(2, 0),
        textcoords="offset points",
        va="center",
        fontsize=6,
        color=GUIDE,
    )


def violin(axes: Axes, x: float, values: NDArray[np.float64], look: Look) -> None:
    """Draw a violin of the values (n,) at `x` with quartiles, median and mean."""
    parts: Any = axes.violinplot(values, [x], widths=0.8, showextrema=False)
    for body in parts["bodies"]:
        body.set(facecolor=look.colour, edgecolor="black", alpha=0.55, lw=0.6, hatch=look.hatch)
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    axes.vlines(x, low, high, color="black", lw=2.5, zorder=3)
    axes.scatter([x], [middle], s=9, color="white", edgecolor="black", lw=0.5, zorder=4)
    axes.scatter([x], [values.mean()], s=14, marker="D", color="black", zorder=4)
