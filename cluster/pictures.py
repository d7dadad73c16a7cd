"""Colours of plots, and their image files."""

import io
from typing import Any

from matplotlib.figure import Figure

BLUE, ORANGE, GREY = "#2a6fbb", "#d9822b", "#8a8f98"


def image(figure: Figure, kind: str = "png", **options: Any) -> bytes:
    """Content of the figure's file. `options` are arguments of `Figure.savefig`."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, dpi=150, **options)
    return buffer.getvalue()
