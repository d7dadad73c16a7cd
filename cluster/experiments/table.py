"""Tables for the terminal and the report."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Value = str | float | int | None
Row = Mapping[str, Value]

_SPREAD = "_std"


def standard_error(means: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard error (...) of the mean of independent samples (n, ...), n > 1."""
    error: NDArray[np.float64] = np.std(means, axis=0, ddof=1) / np.sqrt(len(means))
    return error


def shown(value: Value) -> str:
    """Format a value with a sensible number of digits."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if isinstance(value, int) or abs(value) >= 1000:
        whole = round(value)
        return f"{whole:,}".replace(",", "\u202f") if abs(whole) >= 10_000 else str(whole)
    if value == 0 or 0.01 <= abs(value) < 10:
        return f"{value:.2f}"
    return f"{value:.2g}" if abs(value) < 0.01 else f"{value:.1f}"


def with_spread(row: Row, name: str) -> str:
    """Format a value, with its standard deviation if the row has a column `NAME_std`."""
    spread = row.get(name + _SPREAD)
    return shown(row.get(name)) + ("" if spread is None else f" ± {shown(spread)}")


def heading(column: str) -> str:
    """Return a column's name in words."""
    words = {"se": "SE", "ses": "SEs"}
    return " ".join(words.get(word, word) for word in column.split("_"))


def table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return the formatted rows under headings; standard deviations join their means."""
    names = dict.fromkeys(name for row in rows for name in row if not name.endswith(_SPREAD))
    return pd.DataFrame({heading(n): [with_spread(row, n) for row in rows] for n in names})
