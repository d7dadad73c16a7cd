"""The command `export`: SEs in the formats of other projects."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bilevel.durable import write_file
from bilevel.errors import InvalidInput
from cluster.cli.ses import GivenSE, SEAddress, mlflow_options

if TYPE_CHECKING:
    from bilevel.synthetic_env import StoredSE

_FORMATS = {".onnx": "ONNX", ".pt2": "torch.export"}


@click.command("export")
@click.argument("given", metavar="SE", type=SEAddress())
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@mlflow_options
def export_se(given: GivenSE, out: Path) -> None:
    """Write an SE as ONNX (OUT ends in .onnx) or as a program of torch.export (.pt2).

    SE is a file, a name in the zoo, or an address in MLflow (runs:/..., models:/...). Inputs are
    states (n, S) and actions (n,). Outputs are next states, rewards and done; an episode ends where
    done exceeds 0.5.
    """
    if out.suffix not in _FORMATS:
        allowed = ", ".join(f"*{ending} ({name})" for ending, name in _FORMATS.items())
        raise InvalidInput(f"cannot export to {str(out)!r}: allowed are {allowed}")
    from bilevel.synthetic_env import load_se

    stored = load_se(given.path)
    write_file(out, _onnx(stored) if out.suffix == ".onnx" else _program(stored))
    click.echo(f"written: {out}")


def _onnx(se: "StoredSE") -> bytes:
    from bilevel.interop import onnx_model

    try:
        return bytes(onnx_model(se).SerializeToString())
    except ModuleNotFoundError:
        raise InvalidInput("ONNX is not installed: pip install onnx") from None


def _program(se: "StoredSE") -> bytes:
    import torch

    from bilevel.interop import torch_program

    file = io.BytesIO()
    torch.export.save(torch_program(se), file)
    return file.getvalue()
