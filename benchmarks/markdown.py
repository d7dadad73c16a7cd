"""Markdown tables and the formats of their cells."""

from collections.abc import Iterable, Sequence
from statistics import mean, median
from typing import Any

from scipy.stats import binomtest


def table(head: Sequence[str], rows: Iterable[Sequence[object]], *results: dict[str, Any]) -> str:
    """Return the table, followed by the sources of its results."""
    lines = [head, ["---"] * len(head), *rows]
    text = "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
    return f"{text}\n\n{source(*results)}" if results else text


def source(*results: dict[str, Any]) -> str:
    """Return the machine of the first result, and the commands of all results."""
    machine = results[0]["machine"]
    commands = ", ".join(dict.fromkeys(f"`{result['command']}`" for result in results))
    return f"({machine['cores']} cores of {machine['processor']}; {commands})"


def mean_and_range(values: Sequence[float]) -> str:
    """Format mean, minimum and maximum of scores."""
    return f"{mean(values):.1f} ({min(values):.1f} to {max(values):.1f})"


def median_and_range(values: Sequence[float], form: str = ".0f") -> str:
    """Format median, minimum and maximum."""
    return f"{median(values):{form}} ({min(values):{form}} to {max(values):{form}})"


def format_spread(value: dict[str, float], form: str) -> str:
    """Format the result of `benchmarks.machine.spread`."""
    return f"{value['median']:{form}} ({value['low']:{form}} to {value['high']:{form}})"


def rate_rows(rates: dict[str, dict[str, Any]], columns: Sequence[str], form: str) -> list[Any]:
    """Return a row per measurement: two rates per second, and their ratio in this format."""
    return [
        (
            name,
            *(f"{rate[column]['median']:,.0f}".replace(",", " ") for column in columns),
            format_spread(rate["ratio"], form),
        )
        for name, rate in rates.items()
    ]


def number_and_interval(successes: int, of: int) -> str:
    """Format successes among independent runs with a 95% Clopper-Pearson interval."""
    low, high = binomtest(successes, of).proportion_ci()
    return f"{successes} of {of} ({low:.0%} to {high:.0%})"
