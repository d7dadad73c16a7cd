"""The commands `export` and `import`: SEs in the formats of other projects."""

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
    try:
        from bilevel.interop.onnx import onnx_model
    except ModuleNotFoundError:
        raise InvalidInput("ONNX is not installed: pip install onnx") from None
    return bytes(onnx_model(se).SerializeToString())


def _program(se: "StoredSE") -> bytes:
    import torch

    from bilevel.interop.torch_program import torch_program

    file = io.BytesIO()
    torch.export.save(torch_program(se), file)
    return file.getvalue()


@click.command("import")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--task", metavar="ID", help="Task of gymnasium (default: the file's).")
def import_se(file: Path, out: Path, task: str | None) -> None:
    """Convert an SE of the paper's own code (.pt) to an SE file (OUT ends in .safetensors).

    Only plain values and tensors are read, so that the file cannot run code.
    """
    if out.suffix != ".safetensors":
        raise InvalidInput(f"cannot import to {str(out)!r}: allowed is *.safetensors, an SE file")
    if out.exists() and file.exists() and out.samefile(file):
        raise InvalidInput(f"cannot import {str(file)!r} to itself")
    from bilevel.interop.paper_code import read_paper_se
    from bilevel.synthetic_env import se_bytes

    write_file(out, se_bytes(read_paper_se(file, task)))
    click.echo(f"written: {out}; evaluate it with `bilevel evaluate {out}`")
