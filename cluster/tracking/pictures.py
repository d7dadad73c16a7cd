"""Pictures for MLflow: their colours, and how they become files."""

import io

from matplotlib.figure import Figure

BLUE, ORANGE, GREY = "#2a6fbb", "#d9822b", "#8a8f98"


def png(figure: Figure) -> bytes:
    """A picture as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()
