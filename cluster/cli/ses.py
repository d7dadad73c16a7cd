"""SEs on the command line, and the commands `show`, `export`, `recipe` and `zoo`."""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bilevel.durable import write_file
from bilevel.errors import InvalidInput
from cluster.cli.options import (
    FILE,
    POSITIVE,
    address_option,
    home_option,
    task_option,
    tracking_option,
    workers_option,
)
from cluster.cli.run_options import the_context
from cluster.storage.home import Home

if TYPE_CHECKING:
    from bilevel.synthetic_env import StoredSE
    from bilevel.zoo import Card


def given_se(address: str, home: Path, tracking_uri: str | None) -> tuple[Path, str]:
    """Return the file and label of an SE at a path, a name in the zoo, or an address in MLflow."""
    from bilevel.synthetic_env.source import is_mlflow_address, pinned, se_file
    from bilevel.zoo import ENTRIES

    if address in ENTRIES:
        return se_file(address), f"Synthetic-{address}"
    if not is_mlflow_address(address):
        path = se_file(address)
        return path, _label(path.resolve())
    from cluster.tracking.connection import connected

    place = Home(home)
    uri = tracking_uri or place.database_uri
    if uri == place.database_uri and not place.database.exists():
        raise InvalidInput(f"MLflow has no SE at {address!r}: no runs in {str(place.folder)!r}")
    with connected(uri):
        version = pinned(address, uri)
        return se_file(version, uri), _label(Path(version))


def _label(path: Path) -> str:
    """Return `NAME-VERSION` for models:/NAME/VERSION, the run for a file that every run has, else
    the file's name."""
    from cluster.storage.run_folder import BEST_FILE, LAST_FILE

    if path.parts[0] == "models:":
        return "-".join(path.parts[1:])
    return path.parent.name if path.name in (BEST_FILE, LAST_FILE) else path.stem


def load_se_of(path: Path, task: str | None) -> "StoredSE":
    """Load an SE and, if its task's id is given, import the task's module."""
    from bilevel.synthetic_env import load_se
    from bilevel.tasks import get_task

    stored = load_se(path)
    if task is not None:
        get_task(task, stored.solved_reward, stored.step_limit)
    return stored


def _require_ending(path: Path, *endings: str) -> None:
    if path.suffix not in endings:
        allowed = ", ".join(f"*{ending}" for ending in endings)
        raise InvalidInput(f"cannot write {str(path)!r}: allowed are {allowed}")


@click.command()
@click.argument("se")
@click.option("--out", type=FILE, help="Picture, *.png, *.svg or *.pdf (default: the SE's name).")
@task_option
@home_option
@tracking_option
def show(
    se: str, out: Path | None, se_task: str | None, home: Path, tracking_uri: str | None
) -> None:
    """Draw an SE: the action that it rewards most, the next state after it, the ends of episodes,
    and episodes on the real task that follow its rewards.

    SE is a file, a name in the zoo, or an address in MLflow (runs:/..., models:/...).
    """
    if out is not None:
        _require_ending(out, ".png", ".svg", ".pdf")
    path, label = given_se(se, home, tracking_uri)
    out = out or Path(f"{label}.png")
    stored = load_se_of(path, se_task)

    from cluster.pictures import image
    from cluster.show import SEPlot, picture

    plot = SEPlot.of(stored)
    drawn = picture(plot, f"{label}: a synthetic environment for {stored.task_id}")
    write_file(out, image(drawn, out.suffix[1:]))
    returns = [episode.total for episode in plot.episodes]
    click.echo(
        f"taking the action that the SE rewards most earns {sum(returns) / len(returns):.1f} on "
        f"the real task ({min(returns):.1f} to {max(returns):.1f} in {len(returns)} episodes)"
    )
    click.echo(f"picture: {out}")


@click.command("export")
@click.argument("se")
@click.argument("out", type=FILE)
@home_option
@tracking_option
def export_se(se: str, out: Path, home: Path, tracking_uri: str | None) -> None:
    """Write an SE as ONNX (OUT ends in .onnx) or as a program of torch.export (.pt2).

    SE is a file, a name in the zoo, or an address in MLflow (runs:/..., models:/...). Inputs are
    states (n, S) and actions (n,). Outputs are next states, rewards and done; an episode ends where
    done exceeds 0.5.
    """
    _require_ending(out, ".onnx", ".pt2")
    from bilevel.synthetic_env import load_se

    stored, content = load_se(given_se(se, home, tracking_uri)[0]), io.BytesIO()
    if out.suffix == ".onnx":
        try:
            from bilevel.interop import onnx_model
        except ModuleNotFoundError:
            raise InvalidInput("ONNX is not installed: pip install onnx") from None
        content.write(onnx_model(stored).SerializeToString())
    else:
        import torch

        from bilevel.interop import torch_program

        torch.export.save(torch_program(stored), content)
    write_file(out, content.getvalue())
    click.echo(f"written: {out}")


@click.command()
@click.argument("name")
@click.option(
    "--task", default="CartPole-v0", show_default=True, help="Task for which the recipe is used."
)
def recipe(name: str, task: str) -> None:
    """Print all hyperparameters of the recipe NAME (default, paper, authors or a file, *.toml)."""
    from bilevel.recipes import complete_recipe
    from bilevel.tasks import get_task

    # A recipe depends on neither value, which some tasks do not specify.
    of = get_task(task, solved_reward=1.0, step_limit=1) if task else ""
    click.echo(complete_recipe(name, of), nl=False)


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
