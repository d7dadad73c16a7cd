"""Colours of plots, and their PNG files."""

import io

from matplotlib.figure import Figure

BLUE, ORANGE, GREY = "#2a6fbb", "#d9822b", "#8a8f98"


def png(figure: Figure) -> bytes:
    """Content of the figure's PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()
