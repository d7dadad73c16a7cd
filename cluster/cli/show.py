"""The commands `show` and `recipe`."""

import io
from pathlib import Path

import click

from bilevel.durable import write_file
from bilevel.errors import InvalidInput
from cluster.cli.ses import GivenSE, SEAddress, load_se_of, mlflow_options, task_option

#: Formats of pictures by the file's ending.
FORMATS = (".png", ".svg", ".pdf")


@click.command()
@click.argument("given", metavar="SE", type=SEAddress())
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File of the picture, *.png, *.svg or *.pdf (default: the SE's name, in this folder).",
)
@task_option
@mlflow_options
def show(given: GivenSE, out: Path | None, se_task: str | None) -> None:
    """Draw an SE: the action that it rewards most, the next state after it, the ends of episodes,
    and episodes on the real task that follow its rewards.

    SE is a file, a name in the zoo, or an address in MLflow (runs:/..., models:/...).
    """
    out = out or Path(f"{given.label}.png")
    if out.suffix not in FORMATS:
        raise InvalidInput(f"cannot draw {str(out)!r}: allowed are files {', '.join(FORMATS)}")
    stored = load_se_of(given.path, se_task)

    from cluster.show import Portrait, picture

    portrait = Portrait.of(stored)
    drawn = picture(portrait, f"{given.label}: a synthetic environment for {stored.task_id}")
    content = io.BytesIO()
    drawn.savefig(content, format=out.suffix[1:], dpi=150)
    write_file(out, content.getvalue())
    click.echo(portrait.sentence)
    click.echo(f"picture: {out}")


@click.command()
@click.argument("name")
@click.option(
    "--task", default="CartPole-v0", show_default=True, help="Task for which the recipe is used."
)
def recipe(name: str, task: str) -> None:
    """Print all hyperparameters of the recipe NAME (default, paper, authors or a file, *.toml)."""
    from bilevel.recipes import load_recipe, recipe_text

    click.echo(recipe_text(load_recipe(name, task), f"Recipe {name} for {task}"), nl=False)
