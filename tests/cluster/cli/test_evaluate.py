"""The command `evaluate`, up to where agents would train."""

from pathlib import Path

import pytest

from bilevel.hyperparameters import load_recipe, recipe_text
from cluster.cli.evaluate import _labelled
from cluster.cli.options import label_of
from tests.commands import run_bilevel


def test_the_agents_are_the_recipes(se_file: Path, tmp_path: Path) -> None:
    """Unless others are asked for."""
    text = recipe_text(load_recipe("default", "CartPole-v0"), "Mine.")
    (tmp_path / "mine.toml").write_text(text.replace('agents = ["ddqn"]', 'agents = ["td3"]'))
    result = run_bilevel("evaluate", str(se_file), "--recipe", "mine.toml", cwd=tmp_path)
    assert result.returncode == 2
    assert "recipe 'mine.toml' has no section [td3]" in result.stderr


def test_the_task_of_an_se_is_told(se_file: Path, tmp_path: Path) -> None:
    result = run_bilevel("evaluate", str(se_file), "--task", "Acrobot-v1", cwd=tmp_path)
    assert result.returncode == 2
    assert "--task Acrobot-v1" in result.stderr
    assert "is an SE for CartPole-v0" in result.stderr


def test_an_se_is_called_by_its_run(tmp_path: Path) -> None:
    """Every run has a file `best_se`; a model's lies in folders of MLflow's."""
    for path, label in (
        ("mine.safetensors", "mine"),
        ("runs/CartPole-v0/nes-default-seed0/best_se.safetensors", "nes-default-seed0"),
        ("1a2b/artifacts/best_se.safetensors", "1a2b"),
        ("artifacts/model-77/data/best_se.safetensors", "model-77"),
    ):
        assert label_of(tmp_path / path) == label


def test_two_runs_ses_have_labels_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    files = [Path("one/best_se.safetensors"), Path("two/best_se.safetensors"), Path("two.x")]
    assert list(_labelled(tuple(files[:2]))) == ["one", "two"]
    assert list(_labelled(tuple(files[1:]))) == ["two", f"{tmp_path.name}-two"]
