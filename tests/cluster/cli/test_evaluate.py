"""The command `evaluate`, up to where agents would train."""

from pathlib import Path

import pytest

from bilevel.hyperparameters import load_recipe, recipe_text
from cluster.cli.evaluate import _labelled
from cluster.cli.ses import GivenSE
from tests.commands import run_bilevel
from tests.documents import documented_agent


def test_the_agents_are_the_recipes(se_file: Path, tmp_path: Path) -> None:
    """Unless others are asked for."""
    text = recipe_text(load_recipe("default", "CartPole-v0"), "Mine.")
    (tmp_path / "mine.toml").write_text(text.replace('agents = ["ddqn"]', 'agents = ["td3"]'))
    result = run_bilevel("evaluate", str(se_file), "--recipe", "mine.toml", cwd=tmp_path)
    assert result.returncode == 2
    assert "recipe 'mine.toml' has no section [td3]" in result.stderr


def test_hyperparameters_of_the_agents_are_replaced(se_file: Path, tmp_path: Path) -> None:
    """Of those that take part alone."""
    for setting, told in (
        ("ddqn.batch_size=-1", "ddqn.batch_size must be int, 1 to"),
        ("ddqn.price=1", "unknown hyperparameter 'ddqn.price': allowed are ddqn.init_episodes"),
        ("td3.batch_size=8", "td3.batch_size is of an agent that takes no part; these do: ddqn"),
        ("ddqn.init_episodes=2000", "ddqn.init_episodes must be below ddqn.max_episodes, 1000, or"),
        ("ddqn.max_episodes=50", "ddqn.max_episodes is given twice, as 100 and as 50: give one"),
        ("nes.std_dev=0.1", "unknown hyperparameter 'nes.std_dev': allowed are ddqn.*"),
    ):
        shorter = ("--max-episodes", "100") if "max" in setting else ()
        result = run_bilevel("evaluate", str(se_file), "--set", setting, *shorter, cwd=tmp_path)
        assert result.returncode == 2
        assert told in result.stderr
    assert not (tmp_path / "runs").exists()


def test_the_file_of_an_agent_that_takes_no_part_is_told(se_file: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(documented_agent())
    result = run_bilevel("evaluate", se_file, "--agent-file", "mine.py", cwd=tmp_path)
    assert result.returncode == 2
    assert "'mine.py' registers reinforce, which takes no part: give --agent re" in result.stderr


def test_the_task_of_an_se_is_told(se_file: Path, tmp_path: Path) -> None:
    result = run_bilevel("evaluate", str(se_file), "--task", "Acrobot-v1", cwd=tmp_path)
    assert result.returncode == 2
    assert "--task Acrobot-v1" in result.stderr
    assert "is an SE for CartPole-v0" in result.stderr


def test_an_se_is_called_by_its_run(tmp_path: Path) -> None:
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


def test_two_runs_ses_have_labels_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ses = [GivenSE.of(Path(path)) for path in ("one/best_se.x", "two/best_se.x", "best_se.x")]
    assert list(_labelled(tuple(ses[:2]))) == ["best_se", "two-best_se"]
    assert list(_labelled(tuple(ses[1:]))) == ["best_se", f"{tmp_path.name}-best_se"]
    alike = tuple(GivenSE.of(Path(path)) for path in ("a/x y.x", "b/x_y.x"))
    assert list(_labelled(alike)) == ["x_y", "b-x_y"]
