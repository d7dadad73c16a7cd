"""`bilevel export` and `bilevel import`."""

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from bilevel.synthetic_env import load_se
from tests.bilevel.interop.test_paper_code import Saved, chosen, settings
from tests.commands import run_bilevel


def test_out(se_file: Path, tmp_path: Path) -> None:
    for name in ("se.onnx", "se.pt2"):
        result = run_bilevel("export", se_file, tmp_path / name, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert f"written: {tmp_path / name}" in result.stdout
    assert [i.name for i in onnx.load(str(tmp_path / "se.onnx")).graph.input] == ["state", "action"]
    assert isinstance(torch.export.load(tmp_path / "se.pt2"), torch.export.ExportedProgram)


def test_in(tmp_path: Path) -> None:
    torch.manual_seed(0)
    Saved(chosen(settings())).write(tmp_path / "their.pt", settings())
    result = run_bilevel("import", tmp_path / "their.pt", tmp_path / "my.safetensors", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    se = load_se(tmp_path / "my.safetensors")
    assert se.architecture.hidden_size == 83
    assert np.isfinite(se.psi).all()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("export", "SE", "se.txt"), r"cannot export to 'se.txt': allowed are *.onnx (ONNX)"),
        (("export", "none.safetensors", "se.onnx"), "no SE file at 'none.safetensors'"),
        (("export", "SE", "se.safetensors/a.onnx"), "cannot write 'se.safetensors/a.onnx'"),
        (("export", "SE", "none/a.onnx"), "cannot write 'none/a.onnx': No such file"),
        (("export", "SE", "se.safetensors/a.pt2"), "cannot write 'se.safetensors/a.pt2'"),
        (("import", "none.pt", "se.safetensors"), "no file at 'none.pt'"),
        (("import", "SE", "mine.safetensors"), "is no SE of the paper's code"),
        (("import", "SE", "mine.pt"), "cannot import to 'mine.pt': allowed is *.safetensors"),
        (("import", "SE", "./se.safetensors"), "to itself: it would be lost"),
    ],
)
def test_bad_input_is_one_line(
    words: tuple[str, ...], told: str, se_file: Path, tmp_path: Path
) -> None:
    before = sorted(tmp_path.iterdir())
    given = [str(se_file) if word == "SE" else word for word in words]
    result = run_bilevel(*given, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr.startswith("bilevel: ")
    assert result.stderr.count("\n") == 1
    assert told in result.stderr
    assert sorted(tmp_path.iterdir()) == before
