"""Markdown tables, and the sources of their figures."""

from collections.abc import Iterable, Sequence
from statistics import mean, median
from typing import Any

from scipy.stats import binomtest


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """The table, without a trailing newline."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def mean_and_range(values: Sequence[float]) -> str:
    """Mean, lowest and highest of some scores."""
    return f"{mean(values):.1f} ({min(values):.1f} to {max(values):.1f})"


def median_and_range(values: Sequence[float], form: str = ".0f") -> str:
    """Median, lowest and highest, each in that format."""
    return f"{median(values):{form}} ({min(values):{form}} to {max(values):{form}})"


def number_and_interval(successes: int, of: int) -> str:
    """Successes among independent runs, with the 95% interval of Clopper and Pearson for their
    share."""
    low, high = binomtest(successes, of).proportion_ci()
    return f"{successes} of {of} ({low:.0%} to {high:.0%})"


def source(*results: dict[str, Any]) -> str:
    """The machine of the first result, and the commands of all results, each once."""
    machine = results[0]["machine"]
    commands = ", ".join(dict.fromkeys(f"`{result['command']}`" for result in results))
    return f"({machine['cores']} cores of {machine['processor']}; {commands})"
