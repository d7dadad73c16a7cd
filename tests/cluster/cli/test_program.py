"""The console script, and commands that need no cluster."""

import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bilevel.recipes import load_recipe
from bilevel.tasks import get_task
from cluster.cli.program import cli
from tests.commands import BILEVEL
from tests.studies import make_study

DRY_RUN = ("bohb", "CartPole-v0", "--profile", "smoke", "--dry-run")


@pytest.fixture(autouse=True)
def _in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def bilevel(*arguments: str) -> Result:
    return CliRunner().invoke(cli, arguments)


def test_console_script() -> None:
    result = subprocess.run([BILEVEL], capture_output=True, text=True, timeout=60, check=False)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr.startswith("Usage: bilevel [OPTIONS] COMMAND")
    assert "\n  nes " in result.stderr


def test_interruption_during_imports_has_no_traceback() -> None:
    code = """
import sys
from cluster.cli import main

class Interrupted:
    def find_spec(self, name, path, target=None):
        if name == "cluster.cli.program":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupted())
main()
"""
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (result.returncode, result.stderr) == (130, "")


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_help(name: str) -> None:
    result = bilevel(name, "--help")
    assert result.exit_code == 0
    assert result.stdout.startswith("Usage: ")


@pytest.mark.parametrize("task_id", ["Acrobot-v1", "Pendulum-v1"])
def test_recipe_prints_a_file_that_can_be_used(task_id: str, tmp_path: Path) -> None:
    task = get_task(task_id)
    printed = bilevel("recipe", "default", "--task", task_id)
    assert printed.exit_code == 0
    (tmp_path / "mine.toml").write_text(printed.stdout)
    mine, default = (load_recipe(name, task) for name in ("mine.toml", "default"))
    assert mine.sections == default.sections


@pytest.mark.parametrize(
    ("method", "rungs", "cost"),
    [
        ("bohb", "3 x 1 -> 1 x 3", "5 configurations, 11 core seconds"),
        ("random", "1 x 3", "2 configurations, 6 core seconds"),
    ],
)
def test_dry_run_prints_the_plan_and_writes_nothing(
    method: str, rungs: str, cost: str, tmp_path: Path
) -> None:
    seed = str(2**32)  # exceeds the range of ConfigSpace's seeds
    result = bilevel(*DRY_RUN, "--method", method, "--seed", seed)
    assert result.exit_code == 0, result.stderr
    assert f"'{method}-smoke-core-default-seed{seed}'" in result.stdout
    assert f"      0   {rungs}\n" in result.stdout
    assert cost in result.stdout
    assert [*tmp_path.iterdir()] == []


def test_dry_run_checks_the_settings_of_an_existing_study(tmp_path: Path) -> None:
    make_study(tmp_path / "runs" / "CartPole-v0" / "mine")
    result = bilevel(*DRY_RUN, "--study", "mine", "--seed", "9")
    assert result.exit_code == 2
    assert "'mine' was " in result.stderr
