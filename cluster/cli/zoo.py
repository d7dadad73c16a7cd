"""The command `zoo`."""

from pathlib import Path
from typing import Any

import click

from cluster.cli.decorators import address_option, home_option, tracking_option, workers_option
from cluster.cli.options import the_context
from cluster.cli.parameters import POSITIVE


@click.group(invoke_without_command=True)
@click.pass_context
def zoo(context: click.Context) -> None:
    """List the SEs that come with this package; `zoo build` recreates one."""
    if context.invoked_subcommand is not None:
        return
    from bilevel.zoo import ENTRIES, card
    from cluster.zoo.table import print_zoo

    print_zoo(card(name) for name in ENTRIES)
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
@click.option(
    "--agents",
    type=POSITIVE,
    default=50,
    show_default=True,
    help="Fresh agents of each kind for the card.",
)
@workers_option
@address_option
@tracking_option
@home_option
def build(name: str, folder: Path, agents: int, workers: int | None, **where: Any) -> None:
    """Recreate the SE NAME and its card by an NES run and fresh agents trained on its SE.

    The same command resumes after an interruption.
    """
    from bilevel.zoo import get_entry

    entry, context = get_entry(name), the_context(**where)

    from cluster.zoo.build import BuildCommand
    from cluster.zoo.build import build as make
    from cluster.zoo.table import print_zoo

    print_zoo([make(BuildCommand(entry, context, folder, agents, workers))])
    click.echo(f"written: {folder / name}.safetensors and its card, .json")
