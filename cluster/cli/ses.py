"""SEs on the command line, and the commands `show` and `export`."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bilevel.durable import write_file
from bilevel.errors import InvalidInput
from cluster.cli.options import FILE, home_option, task_option, tracking_option
from cluster.storage.home import Home

if TYPE_CHECKING:
    from bilevel.synthetic_env import StoredSE


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
    click.echo(plot.sentence)
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
