"""The command `evaluate`, up to where agents would train."""

from pathlib import Path

from bilevel.hyperparameters import load_recipe, recipe_text
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
