"""The zoo as a table."""

from collections.abc import Iterable

from rich.console import Console
from rich.table import Table

from bilevel.zoo import Card, env_id


def print_zoo(cards: Iterable[Card]) -> None:
    """Print one row for each SE and kind of agents trained on it."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("gymnasium id", no_wrap=True)
    for title in ("agents", "mean return", "solved", "train steps"):
        table.add_column(title, justify="right", no_wrap=True)
    for card in cards:
        for number, row in enumerate(card.taught):
            table.add_row(
                "" if number else env_id(card.name),
                f"{row.agents} {row.agent}",
                f"{row.mean_return:.1f}",
                f"{row.solved_fraction:.0%}",
                f"{row.train_steps:.0f}",
            )
    Console(highlight=False).print(table)
