"""SEs on the command line: labels and export."""

from pathlib import Path

import onnx
import pytest
import torch
from click.testing import CliRunner

from cluster.cli.program import cli
from cluster.cli.ses import given_se


@pytest.mark.parametrize(
    ("file", "label"),
    [("mine.safetensors", "mine"), ("nes-default-seed0/best_se.safetensors", "nes-default-seed0")],
)
def test_label_is_the_name_of_the_file_or_its_run(file: str, label: str, tmp_path: Path) -> None:
    """Every run has a file `best_se`."""
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    path.touch()
    assert given_se(str(path), tmp_path, None) == (path, label)


def test_export(se_file: Path, tmp_path: Path) -> None:
    for name in ("se.onnx", "se.pt2"):
        result = CliRunner().invoke(cli, ["export", str(se_file), str(tmp_path / name)])
        assert result.exit_code == 0, result.stderr
    assert [i.name for i in onnx.load(str(tmp_path / "se.onnx")).graph.input] == ["state", "action"]
    assert isinstance(torch.export.load(tmp_path / "se.pt2"), torch.export.ExportedProgram)
