"""The zoo as a table."""

from collections.abc import Iterable

from rich.console import Console
from rich.table import Table

from bilevel.zoo import Card


def print_zoo(cards: Iterable[Card]) -> None:
    """Print, for each SE, how each kind of agents does that it taught."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("gymnasium id", "agents", "mean return", "solved", "train steps"):
        table.add_column(
            title, justify="left" if title == "gymnasium id" else "right", no_wrap=True
        )
    for card in cards:
        for number, taught in enumerate(card.taught):
            table.add_row(
                "" if number else card.env_id,
                f"{taught.agents} {taught.agent}",
                f"{taught.mean_return:.1f}",
                f"{taught.solved_fraction:.0%}",
                f"{taught.train_steps:.0f}",
            )
    Console(highlight=False).print(table)
