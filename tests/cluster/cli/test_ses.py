"""SEs on the command line: labels and export."""

from pathlib import Path

import onnx
import pytest
import torch
from click.testing import CliRunner

from cluster.cli.evaluate import labelled
from cluster.cli.program import cli
from cluster.cli.ses import GivenSE


def test_label_is_the_name_of_the_file_or_its_run(tmp_path: Path) -> None:
    """Every run has a file `best_se`."""
    run, other = tmp_path / "nes-default-seed0", tmp_path / "other"
    run.mkdir()
    (run / "settings.json").touch()
    for path, label in (
        (run / "mine.safetensors", "mine"),
        (run / "best_se.safetensors", run.name),
        (other / "best_se.safetensors", "best_se"),
    ):
        assert GivenSE.of(path).label == label


@pytest.mark.parametrize(
    ("paths", "labels"),
    [
        (["one/best_se.x", "two/best_se.x"], ["best_se", "two-best_se"]),
        (["two/best_se.x", "here/best_se.x"], ["best_se", "here-best_se"]),
        (["a/x y.x", "b/x_y.x"], ["x_y", "b-x_y"]),
    ],
)
def test_equal_labels_get_the_name_of_their_folder(paths: list[str], labels: list[str]) -> None:
    assert list(labelled(tuple(GivenSE.of(Path(path)) for path in paths))) == labels


def test_export(se_file: Path, tmp_path: Path) -> None:
    for name in ("se.onnx", "se.pt2"):
        result = CliRunner().invoke(cli, ["export", str(se_file), str(tmp_path / name)])
        assert result.exit_code == 0, result.stderr
    assert [i.name for i in onnx.load(str(tmp_path / "se.onnx")).graph.input] == ["state", "action"]
    assert isinstance(torch.export.load(tmp_path / "se.pt2"), torch.export.ExportedProgram)
