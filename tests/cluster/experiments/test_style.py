"""Pictures are readable in grey prints."""

from collections.abc import Sequence
from itertools import pairwise

import pytest
from matplotlib.colors import to_rgb

from cluster.experiments.figures import sample_efficiency, transfer
from cluster.experiments.figures.success import SUCCESS
from cluster.experiments.sizes import get_size
from cluster.experiments.style import LOOKS, SERIES, Look, number


def lightness(look: Look) -> float:
    """Return the lightness of the colour in grey (ITU-R BT.709), on [0, 1]."""
    red, green, blue = to_rgb(look.colour)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize(
    "looks",
    [
        [LOOKS[name] for name in transfer.SOURCES],
        [LOOKS[name] for name in sample_efficiency.SOURCES],
        [LOOKS[name] for name in SUCCESS.runs(get_size("local"))],
        SERIES,
    ],
)
def test_series_of_a_picture_differ_in_lightness_line_and_marker(looks: Sequence[Look]) -> None:
    in_order = sorted(map(lightness, looks))
    assert min(b - a for a, b in pairwise(in_order)) > 0.1
    assert in_order[-1] < 0.85  # visible on white
    for kind in ("line", "marker"):
        assert len({getattr(look, kind) for look in looks}) == len(looks)


def test_numbers_have_a_minus_sign() -> None:
    assert number(-87.24, ".1f") == "\N{MINUS SIGN}87.2"
    assert number(195.0) == "195"
