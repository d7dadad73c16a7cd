"""The commands `recipe` and `zoo`: what comes with this package."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cluster.cli import options
from cluster.cli.options import POSITIVE
from cluster.cli.run_options import the_context

if TYPE_CHECKING:
    from bilevel.zoo import Card


@click.command()
@click.argument("name")
@click.option(
    "--task", default="CartPole-v0", show_default=True, help="Task for which the recipe is used."
)
def recipe(name: str, task: str) -> None:
    """Print all hyperparameters of the recipe NAME (default, paper, authors or a file, *.toml)."""
    from bilevel.recipes import complete_recipe

    click.echo(complete_recipe(name, task), nl=False)


@click.group(invoke_without_command=True)
@click.pass_context
def zoo(context: click.Context) -> None:
    """List the SEs that come with this package; `zoo build` recreates one."""
    if context.invoked_subcommand is not None:
        return
    from bilevel.zoo import ENTRIES, card

    _print_zoo(card(name) for name in ENTRIES)
    click.echo('use one with `import bilevel, gymnasium; gymnasium.make("bilevel/Synthetic-...")`')


@zoo.command()
@click.argument("name")
@click.option(
    "--folder",
    type=click.Path(path_type=Path),
    default=".",
    show_default=True,
    help="Folder for NAME.safetensors and its card NAME.json.",
)
@click.option("--agents", type=POSITIVE, default=50, help="Agents of each kind (default: 50).")
@options.workers_option
@options.address_option
@options.tracking_option
@options.home_option
def build(name: str, folder: Path, agents: int, workers: int | None, **where: Any) -> None:
    """Recreate the SE NAME and its card by an NES run and fresh agents trained on its SE.

    The same command resumes after an interruption.
    """
    from bilevel.zoo import get_entry

    entry, context = get_entry(name), the_context(**where)

    from cluster.zoo import build as make

    _print_zoo([make(entry, context, folder, agents, workers)])
    click.echo(f"written: {folder / name}.safetensors and its card, .json")


def _print_zoo(cards: Iterable["Card"]) -> None:
    """Print one line for each SE and kind of agents trained on it."""
    from bilevel.zoo import env_id

    click.echo(f"{'gymnasium id':36}{'agents':>17}{'mean return':>13}{'solved':>8}{'steps':>8}")
    for card in cards:
        for row in card.scores:
            click.echo(
                f"{env_id(card.name):36}{f'{row.agents} {row.agent}':>17}{row.mean_return:13.1f}"
                f"{row.solved_fraction:8.0%}{row.train_steps:8.0f}"
            )
