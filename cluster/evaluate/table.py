"""Tables of evaluations and experiments."""

from collections.abc import Mapping, Sequence

import pandas as pd

Value = str | float | int | None
Row = Mapping[str, Value]


def shown(value: Value) -> str:
    """Format a value with a sensible number of digits."""
    if value is None or isinstance(value, str):
        return value or "-"
    if isinstance(value, int) or abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.3g}"


def with_spread(row: Row, name: str) -> str:
    """Format a value, with its standard deviation if the row has it.

    The standard deviation of NAME or NAME_mean is NAME_std.
    """
    spread = row.get(name.removesuffix("_mean") + "_std")
    return shown(row.get(name)) + ("" if spread is None else f" ± {shown(spread)}")


def heading(name: str) -> str:
    """Return the name of a column in words."""
    return name.removesuffix("_mean").replace("_", " ")


def table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return the formatted rows; standard deviations join their means."""
    names = dict.fromkeys(name for row in rows for name in row if not name.endswith("_std"))
    return pd.DataFrame({heading(n): [with_spread(row, n) for row in rows] for n in names})
