"""The command line in processes of its own: help, bad input, nothing half-written."""

import subprocess
from pathlib import Path

import pytest

from tests.commands import BILEVEL, run_bilevel


def test_the_console_script() -> None:
    result = subprocess.run(
        [BILEVEL, "--help"], capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 0
    assert result.stdout.startswith("Usage: bilevel ")


@pytest.mark.parametrize(
    "command", [[], ["nes"], ["bohb"], ["studies"], ["sync"], ["up"], ["down"], ["ui"]]
)
def test_help(command: list[str], tmp_path: Path) -> None:
    result = run_bilevel(*command, "--help", cwd=tmp_path)
    assert result.returncode == 0
    assert "Usage: " in result.stdout


@pytest.mark.parametrize(
    ("args", "told"),
    [
        (["nes", "CartPole-v9"], "unknown task 'CartPole-v9': allowed are CartPole-v0, Acrobot-v1"),
        (["nes", "Taxi-v4"], "allowed is a Box of one dimension"),
        (["nes", "MountainCarContinuous-v0"], "allowed is Discrete"),
        (["nes", "CartPole-v0", "--agent", "dqn"], "unknown agent 'dqn': allowed are ddqn"),
        (["nes", "CartPole-v0", "--preset", "x"], "unknown preset 'x': allowed are tuned, default"),
        (["nes", "CartPole-v0", "--update", "x"], "unknown update 'x': allowed are paired"),
        (["nes", "CartPole-v0", "--vary-hp", "x"], "unknown variation of agents 'x': allowed are"),
        (["nes", "CartPole-v0", "--set", "nes.step_price=-1"], "step_price must be float, 0.0 to"),
        (["nes", "CartPole-v0", "--set", "nes.step_price=x"], "float, 0.0 to 1.0; got 'x'"),
        (
            ["nes", "CartPole-v0", "--set", "nes.price=1"],
            "unknown hyperparameter 'nes.price': allowed are nes.step_size",
        ),
        (
            ["nes", "CartPole-v0", "--set", "td3.discount=1"],
            "'td3.discount': allowed are nes.*, se.*, ddqn.*",
        ),
        (["nes", "CartPole-v0", "--set", "nes.momentum"], "'nes.momentum' is not a setting"),
        (
            ["evaluate", "--real", "CartPole-v0", "--vary-hp", "x"],
            "unknown variation of agents 'x': allowed are",
        ),
        (["nes", "CartPole-v0", "--population", "0"], "'--population': 0 is not in the range x>=1"),
        (["nes", "CartPole-v0", "--population", "999999"], "population_size must be int, 1 to"),
        (["nes", "CartPole-v0", "--workers", "4096"], "need 4096 cores: the cluster has"),
        (["nes", "CartPole-v0", "--address", "127.0.0.1:1"], "no Ray cluster at '127.0.0.1:1'"),
        (["nes", "CartPole-v0", "--address", "nowhere"], "Ray address 'nowhere' is not valid"),
        (
            ["nes", "CartPole-v0", "--tracking-uri", "http://127.0.0.1:1"],
            "no MLflow server at 'http://127.0.0.1:1'",
        ),
        (
            ["nes", "CartPole-v0", "--tracking-uri", "ftp://x"],
            "tracking URI 'ftp://x' is not valid",
        ),
        (["nes", "CartPole-v0", "--home", "/proc/none"], "cannot write to '/proc/none'"),
        (["nes", "CartPole-v0", "--name", "../escape"], "name '../escape' is not allowed"),
        (["bohb", "CartPole-v0", "--study", "a/b"], "name 'a/b' is not allowed"),
        (["bohb", "CartPole-v0", "--profile", "huge"], "unknown profile 'huge': allowed are smoke"),
        (
            ["bohb", "CartPole-v0", "--method", "luck"],
            "unknown method 'luck': allowed are bohb, hyperband, random",
        ),
        (
            ["bohb", "CartPole-v0", "--space", "x"],
            "unknown search space 'x': allowed are full, core",
        ),
        (["nes", "CartPole-v0", "--seed", "one"], "'--seed': 'one' is not a whole number"),
        (["nes", "CartPole-v0", "--seed", "0.5"], "allowed are 0 or more"),
        (["ui", "--port", "http"], "'http' is not a whole number: allowed are 1 to 65535"),
        (["bohb", "CartPole-v0", "--time-budget", "soon"], "'soon' is not a duration"),
        (
            ["bohb", "CartPole-v0", "--workers-per-trial", "64"],
            "1 trial(s) of 64 worker(s) need 64 cores",
        ),
        (["bohb"], "Missing argument 'TASK'"),
        (["ui"], "no runs in"),
        (["sync", "none"], "no study is called 'none'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(args: list[str], told: str, tmp_path: Path) -> None:
    result = run_bilevel(*args, cwd=tmp_path)
    assert result.returncode == 2, result.stderr
    assert result.stderr.startswith("bilevel: ")
    assert result.stderr.count("\n") == 1
    assert told in result.stderr
    assert result.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_database_is_told(tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").write_text("garbage")
    result = run_bilevel("nes", "CartPole-v0", "--home", str(tmp_path), cwd=tmp_path)
    assert result.returncode == 2
    assert "cannot be used" in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "CartPole-v0").exists()


@pytest.mark.parametrize(
    ("method", "title", "rungs", "cost"),
    [
        ("bohb", "BOHB", "3 x 1 -> 1 x 3", "11 generations, 66 evaluations"),
        ("hyperband", "Hyperband", "3 x 1 -> 1 x 3", "11 generations, 66 evaluations"),
        ("random", "random search", "1 x 3", "6 generations, 36 evaluations"),
    ],
)
def test_dry_run_says_what_would_be_run_and_writes_nothing(
    method: str, title: str, rungs: str, cost: str, tmp_path: Path
) -> None:
    arguments = ("CartPole-v0", "--profile", "smoke", "--dry-run", "--method", method)
    result = run_bilevel("bohb", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    study = f"{method}-smoke-core-seed0"
    assert result.stdout.startswith(f"{title} on CartPole-v0: study {study!r}")
    assert f"      0   {rungs}\n" in result.stdout
    assert cost in result.stdout
    assert "the cluster can place it" in result.stdout
    assert list(tmp_path.iterdir()) == []


def test_dry_run_counts_the_fits_of_starts(tmp_path: Path) -> None:
    """And brackets that all begin at the smallest budget."""
    arguments = ("--profile", "local", "--brackets", "3", "--dry-run")
    result = run_bilevel("bohb", "CartPole-v0", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "      0   3 x 3 -> 1 x 9\n    ...   and so on\n" in result.stdout
    # 32 agents on each of the SEs of which one decides where all configurations start
    assert "3 brackets: 45 generations, 4 fitted starts of about" in result.stdout
    assert f"{45 * 24 + 4 * 32} evaluations" in result.stdout
    assert "time budget" not in result.stdout
