"""Rows of values, as CSV, as lines of text and as HTML.

A column `X` that is followed by a column `X_std` is shown as "X ± std".
"""

import csv
import html
import io
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Value = str | float | int | None
Row = Mapping[str, Value]

_SPREAD = "_std"


def standard_error(means: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard error (...) of the mean of independent samples (n, ...), two or more."""
    error: NDArray[np.float64] = np.std(means, axis=0, ddof=1) / np.sqrt(len(means))
    return error


def csv_bytes(rows: Sequence[Row]) -> bytes:
    """Content of a CSV file with the columns of all rows."""
    out = io.StringIO()
    columns = dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(out, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue().encode()


def shown(value: Value) -> str:
    """A value with as many digits as a reader wants."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f") if abs(value) >= 10_000 else str(value)
    if value == 0 or 0.01 <= abs(value) < 10:
        return f"{value:.2f}"
    return f"{value:.2g}" if abs(value) < 0.01 else shown_large(value)


def shown_large(value: float) -> str:
    """A value of ten or more: one decimal place, or none from a thousand on."""
    return f"{value:.1f}" if abs(value) < 1000 else shown(round(value))


def cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Headings and texts of a table of rows."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    names = [name for name in columns if not name.endswith(_SPREAD)]

    def text(row: Row, name: str) -> str:
        spread = row.get(name + _SPREAD)
        told = shown(row.get(name))
        return told if spread is None else f"{told} ± {shown(spread)}"

    return [*map(heading, names)], [[text(row, name) for name in names] for row in rows]


def heading(column: str) -> str:
    """A column's name in words."""
    words = {"se": "SE", "ses": "SEs"}
    return " ".join(words.get(word, word) for word in column.split("_"))


def text_lines(rows: Sequence[Row]) -> list[str]:
    """The table as aligned lines of text."""
    heading, lines = cells(rows)
    widths = [max(map(len, column)) for column in zip(heading, *lines, strict=True)]
    return [
        "  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip()
        for line in (heading, *lines)
    ]


def html_table(rows: Sequence[Row]) -> str:
    """The table as HTML."""
    heading, lines = cells(rows)
    head = "".join(f"<th>{html.escape(name)}</th>" for name in heading)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(text)}</td>" for text in line) + "</tr>"
        for line in lines
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
