"""The command line in separate processes: help, invalid input, no files written."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import ConfigSpace as CS
import numpy as np
import pytest
import safetensors.numpy

from bilevel.synthetic_env import save_se
from bilevel.tasks import get_task
from tests.commands import BILEVEL, run_bilevel
from tests.ses import make_se
from tests.studies import make_study

RECIPES = Path(str(files("bilevel.hyperparameters.recipes")))


def test_the_console_script() -> None:
    result = subprocess.run(
        [BILEVEL, "--help"], capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 0
    assert result.stdout.startswith("Usage: bilevel ")


def test_without_a_command_it_tells_which_there_are() -> None:
    result = subprocess.run([BILEVEL], capture_output=True, text=True, timeout=60, check=False)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr.startswith("Usage: bilevel [OPTIONS] COMMAND")
    assert "\n  nes " in result.stderr


def test_a_narrow_encoding_ends_nothing() -> None:
    code = """
import sys
from cluster.cli import main
sys.argv = ["bilevel", "--version"]
try:
    main()
finally:
    print("16\u202f888")
"""
    result = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.endswith("16?888\n")


def test_ctrl_c_while_the_program_is_loaded_is_no_traceback() -> None:
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


@pytest.mark.parametrize(
    "command",
    [[], ["nes"], ["bohb"], ["experiment"], ["runs"], ["sync"], ["up"], ["down"], ["ui"]],
)
def test_help(command: list[str], tmp_path: Path) -> None:
    result = run_bilevel(*command, "--help", cwd=tmp_path)
    assert result.returncode == 0
    assert "Usage: " in result.stdout


@pytest.mark.parametrize(
    ("args", "told"),
    [
        (["nes", "CartPole-v9"], "unknown task 'CartPole-v9': allowed are CartPole-v0, Acrobot-v1"),
        (["nes", "CartPole"], "'CartPole' has no version: allowed are CartPole-v0, CartPole-v1"),
        (["nes", "Pendulum-v1"], "Pendulum-v1 has actions Box"),
        (["show", "models:/SE-CartPole-v0@newest"], "MLflow has no SE at 'models:/SE-CartPole-v0@"),
        (["nes", "CartPole-v0", "--home", ""], "'--home': '' is not a folder: give its path"),
        (["bohb", "CartPole-v0", "--brackets", "99999999"], "not in the range 1<=x<=1000"),
        (["nes", "Taxi-v4"], "allowed is a Box of one dimension"),
        (["nes", "MountainCarContinuous-v0"], "allowed is Discrete"),
        (["nes", "CartPole-v0", "--agent", "dqn"], "unknown agent 'dqn': allowed are ddqn"),
        (
            ["nes", "CartPole-v0", "--recipe", "x"],
            "unknown recipe 'x': allowed are default, paper, authors, distilled",
        ),
        (["bohb", "CartPole-v0", "--recipe", "x"], "unknown recipe 'x': allowed are default"),
        (["evaluate", "--real", "CartPole-v0", "--recipe", "x"], "unknown recipe 'x': allowed are"),
        (
            ["experiment", "x", "CartPole-v0"],
            "unknown experiment 'x': allowed are success, transfer, behaviour, sample-efficiency",
        ),
        (["experiment", "cost", "CartPole-v9"], "unknown task 'CartPole-v9': allowed are"),
        (
            ["experiment", "cost", "CartPole-v0", "--size", "x"],
            "unknown size 'x': allowed are smoke",
        ),
        (["experiment", "cost", "CartPole-v0", "--ses", "0"], "0 is not in the range 1<=x<=1000"),
        (["experiment", "cost", "CartPole-v0", "--agent", "x"], "unknown agent 'x': allowed are"),
        (
            ["experiment", "report", "CartPole-v0", "--size", "smoke"],
            "begin with `bilevel experiment all CartPole-v0 --size smoke`",
        ),
        (["nes", "CartPole-v0", "--recipe", "x.toml"], "cannot read the recipe 'x.toml': No such"),
        (["nes", "CartPole-v0", "--vary-hp", "x"], "unknown variation of agents 'x': allowed are"),
        (["bohb", "CartPole-v0", "--vary-hp", "x"], "unknown variation of agents 'x': allowed are"),
        (
            ["nes", "CartPole-v0", "--set", "nes.update=x"],
            "unknown nes.update 'x': allowed are snes",
        ),
        (["nes", "CartPole-v0", "--set", "nes.std_dev=-1"], "std_dev must be float, 1e-06 to"),
        (["bohb", "CartPole-v0", "--set", "nes.std_dev=x"], "float, 1e-06 to 10.0; got 'x'"),
        (
            ["bohb", "CartPole-v0", "--set", "nes.solved_for=9"],
            "nes.solved_for cannot be set to 9 in a search: all of its runs end once an SE is",
        ),
        (
            ["nes", "CartPole-v0", "--set", "nes.price=1"],
            "unknown hyperparameter 'nes.price': allowed are nes.update",
        ),
        (
            ["bohb", "CartPole-v0", "--set", "nes.price=1"],
            "unknown hyperparameter 'nes.price': allowed are nes.update",
        ),
        (
            ["nes", "CartPole-v0", "--set", "td3.discount=1"],
            "td3.discount is of an agent that takes no part; these do: ddqn (--agent)",
        ),
        (
            ["nes", "CartPole-v0", "--generations", "3", "--set", "nes.generations=4"],
            "nes.generations is given twice, as 3 and as 4",
        ),
        (
            ["bohb", "CartPole-v0", "--set", "nes.std_dev=1", "--set", "nes.std_dev=2"],
            "nes.std_dev is given twice, as 1 and as 2",
        ),
        (["nes", "CartPole-v0", "--set", "nes.std_dev"], "'nes.std_dev' is not a setting"),
        (
            ["bohb", "CartPole-v0", "--prior", "none", "--set", "nes.averaging=0.5"],
            "nes.averaging is searched in the space 'core', so that setting it to 0.5 has no",
        ),
        (  # the search begins there
            ["bohb", "CartPole-v0", "--set", "nes.std_dev=0.3", "--home", "/proc/none"],
            "cannot write to '/proc/none'",
        ),
        (
            ["bohb", "CartPole-v0", "--space", "full", "--recipe", "authors", "--vary-hp", "all"],
            "ddqn.learning_rate is searched in the space 'full', but runs draw it for",
        ),
        (
            ["bohb", "CartPole-v0", "--profile", "smoke", "--population", "4"],
            "nes.population_size is searched in the space 'core'",
        ),
        (
            ["nes", "CartPole-v0", "--set", "nes.mirrored_sampling=false"],
            "nes.update 'snes' needs nes.mirrored_sampling true",
        ),
        (
            ["nes", "CartPole-v0", "--set", "nes.start=distilled"],
            "nes.start 'distilled' needs se.structure 'plain'",
        ),
        (["nes", "CartPole-v0", "--set", "se.hidden_size=7"], "an se.hidden_size of at least 8"),
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
            ["bohb", "CartPole-v0", "--address", "ray://127.0.0.1:1"],
            "Ray address 'ray://127.0.0.1:1' is not valid: allowed are host:port and auto",
        ),
        (
            ["nes", "CartPole-v0", "--tracking-uri", "http://127.0.0.1:1"],
            "no MLflow server at 'http://127.0.0.1:1'",
        ),
        (
            ["nes", "CartPole-v0", "--tracking-uri", "ftp://x"],
            "tracking URI 'ftp://x' is not valid",
        ),
        (
            ["nes", "CartPole-v0", "--tracking-uri", "http://[::1"],
            "tracking URI 'http://[::1' is not valid",
        ),
        (
            ["nes", "CartPole-v0", "--tracking-uri", "sqlite:foo"],
            "tracking URI 'sqlite:foo' is not valid",
        ),
        (
            ["nes", "CartPole-v0", "--tracking-uri", "mysql://me:secret@h/db"],
            "of the kind mysql:// needs a package that is not installed",
        ),
        (
            ["nes", "CartPole-v0", "--tracking-uri", "http://me:secret@127.0.0.1:1"],
            "no MLflow server at 'http://***@127.0.0.1:1'",
        ),
        (["nes", "CartPole-v0", "--home", "a?b"], "its path must have no ? and %"),
        (["nes", "CartPole-v0", "--home", "/proc/none"], "cannot write to '/proc/none'"),
        (
            ["bohb", "CartPole-v0", "--dry-run", "--home", "/proc/none"],
            "cannot write to '/proc/none'",
        ),
        (["zoo", "build", "CartPole-v0", "--folder", "/proc/none"], "cannot write to '/proc/none'"),
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
        (
            ["bohb", "CartPole-v0", "--space", "full"],
            "needs plain SEs and the rule paper or authors (--recipe authors or paper); the "
            "recipe 'default' has exogenous SEs and the rule snes",
        ),
        (
            ["bohb", "CartPole-v0", "--space", "full", "--recipe", "distilled"],
            "the recipe 'distilled' has plain SEs and the rule antithetic",
        ),
        (["bohb", "CartPole-v0", "--space", "x.json"], "cannot read the search space 'x.json': No"),
        (
            ["bohb", "CartPole-v0", "--worst-score", "200"],
            "worst score (--worst-score) must be finite and below the solved reward, 195; got 200",
        ),
        (
            ["nes", "CartPole-v0", "--set", "ddqn.init_episodes=150"],
            "ddqn.init_episodes must be below nes.patient_episodes, ",
        ),
        (["nes", "CartPole-v0", "--seed", "one"], "'--seed': 'one' is not a whole number"),
        (["nes", "CartPole-v0", "--seed", "0.5"], "allowed are 0 or more"),
        (["ui", "--port", "http"], "'http' is not a whole number: allowed are 1 to 65535"),
        (["nes", "CartPole-v0", "--name", ""], "'--name': '' is empty: give a value, or leave"),
        (["bohb", "CartPole-v0", "--study", ""], "'--study': '' is empty"),
        (["bohb", "CartPole-v0", "--recipe", ""], "'--recipe': '' is empty"),
        (["evaluate", "--real", "CartPole-v0", "--address", ""], "'--address': '' is empty"),
        (["bohb", "CartPole-v0", "--time-budget", "soon"], "'soon' is not a duration"),
        (
            ["bohb", "CartPole-v0", "--workers-per-trial", "4096"],
            "4096 workers need 4096 cores",
        ),
        (["bohb"], "Missing argument 'TASK'"),
        (["ui"], "no runs in"),
        (["sync", "none"], "no run is called 'none'"),
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


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("nonsense", "is not a TOML file"),
        ("[nes]\nstep_size = 1.0\n", "recipe 'my.toml': 'agents' is missing"),
        ('agents = ["ddqn"]\nnes = 3\n', "recipe 'my.toml'"),
        (
            (RECIPES / "default.toml").read_text().replace("vary_agent", "vary_hp", 1),
            "recipe 'my.toml': 'vary_agent' is missing",
        ),
        (
            "bar = 3\n" + (RECIPES / "default.toml").read_text(),
            "recipe 'my.toml': unknown entry 'bar': allowed are agents, vary_agent, nes, se, ddqn",
        ),
    ],
)
def test_a_file_that_is_no_recipe_is_told_in_one_line(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_text(text)
    result = run_bilevel("nes", "CartPole-v0", "--recipe", "my.toml", cwd=tmp_path)
    assert result.returncode == 2
    assert told in result.stderr
    assert result.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["my.toml"]


def test_a_recipe_of_the_users_own(tmp_path: Path) -> None:
    """The study's name contains the names of recipe, agents and variation."""
    text = (files("bilevel.hyperparameters.recipes") / "default-CartPole-v0.toml").read_text()
    (tmp_path / "my.toml").write_text(text.replace('update = "snes"', 'update = "antithetic"'))
    small = ("--profile", "smoke", "--dry-run", "--agent", "ddqn", "--vary-hp", "no")
    result = run_bilevel("bohb", "CartPole-v0", "--recipe", "my.toml", *small, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "study 'bohb-smoke-core-my-ddqn-no-seed0'" in result.stdout
    wrong = run_bilevel(
        *("bohb", "CartPole-v0", "--recipe", "my.toml", *small),
        *("--set", "nes.mirrored_sampling=false"),
        cwd=tmp_path,
    )
    assert wrong.returncode == 2
    assert "nes.update 'antithetic' needs nes.mirrored_sampling true" in wrong.stderr


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (["nes", "CartPole-v0"], "mlflow.db' is damaged: file is not a database; move it away"),
        (["ui"], "mlflow.db' is damaged: file is not a database; move it away"),
        (["up"], "mlflow.db' is damaged: file is not a database; move it away"),
    ],
)
def test_a_damaged_database_is_told(command: list[str], told: str, tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").write_text("garbage, and more of it than a header of SQLite has" * 9)
    result = run_bilevel(*command, "--home", str(tmp_path), cwd=tmp_path)
    assert result.returncode == 2
    assert told in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "CartPole-v0").exists()


def test_tensors_of_something_else_are_no_se(tmp_path: Path) -> None:
    file = tmp_path / "weights.safetensors"
    safetensors.numpy.save_file({"weight": np.zeros(3, np.float32)}, file)
    result = run_bilevel("evaluate", file, cwd=tmp_path)
    assert result.returncode == 2
    assert "weights.safetensors' holds tensors of something else than an SE" in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("method", "title", "rungs", "cost"),
    [
        (
            "bohb",
            "BOHB",
            "3 x 1 -> 1 x 3",
            "2 brackets: 5 configurations, 11 core seconds and 4 of",
        ),
        ("hyperband", "Hyperband", "3 x 1 -> 1 x 3", "2 brackets: 5 configurations, 11 core s"),
        (
            "random",
            "random search",
            "1 x 3",
            "2 brackets: 2 configurations, 6 core seconds (too few for a validation)",
        ),
    ],
)
def test_dry_run_says_what_would_be_run_and_writes_nothing(
    method: str, title: str, rungs: str, cost: str, tmp_path: Path
) -> None:
    large = str(2**32)  # more than ConfigSpace takes
    arguments = ("CartPole-v0", "--profile", "smoke", "--dry-run", "--method", method)
    result = run_bilevel("bohb", *arguments, "--seed", large, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    study = f"{method}-smoke-core-default-seed{large}"
    assert result.stdout.startswith(f"{title} on CartPole-v0: study {study!r}, prior none")
    assert f"      0   {rungs}\n" in result.stdout
    assert cost in result.stdout
    # measured on this machine, whatever it is
    found = re.search(r"a core second takes (\d+\.\d\d) s$", result.stdout, re.MULTILINE)
    assert found is not None
    assert 0.1 < float(found[1]) < 100
    assert "the cluster can place it" in result.stdout
    assert list(tmp_path.iterdir()) == []


def test_the_local_profile_begins_with_the_recipe_and_at_the_smallest_budget(
    tmp_path: Path,
) -> None:
    arguments = ("--profile", "local", "--brackets", "3", "--time-budget", "9h", "--dry-run")
    result = run_bilevel("bohb", "CartPole-v0", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert ", prior recipe, " in result.stdout
    assert "      0   9 x 30 -> 3 x 90 -> 1 x 270\n    ...   and so on\n" in result.stdout
    assert "3 brackets: 27 configurations, 1890 core seconds and 630 of validation" in result.stdout
    assert "time budget" not in result.stdout


def test_a_dry_run_of_a_study_that_cannot_be_run(tmp_path: Path) -> None:
    """Too little time is told, other settings than those it was begun with are refused."""
    make_study(tmp_path / "runs" / "CartPole-v0" / "mine")
    arguments = ("bohb", "CartPole-v0", "--profile", "smoke", "--dry-run")
    result = run_bilevel(*arguments, "--time-budget", "0.001s", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "is not enough for one bracket:\n1 bracket: 3 conf" in result.stdout
    result = run_bilevel(*arguments, "--study", "mine", "--seed", "9", cwd=tmp_path)
    assert result.returncode == 2
    assert "'mine' was begun with " in result.stderr


@pytest.mark.parametrize("command", ["nes", "evaluate"])
def test_a_mistake_in_the_users_own_task_is_told_before_anything_is_written(
    command: str, tmp_path: Path
) -> None:
    """By commands that are given the task, or an SE of it."""
    (tmp_path / "mine.py").write_text(
        """
import gymnasium
from gymnasium.envs.classic_control import CartPoleEnv

class Mine(CartPoleEnv):
    def step(self, action):
        raise RuntimeError("the simulator broke")

gymnasium.register("Mine-v0", Mine, max_episode_steps=9, reward_threshold=8)
"""
    )
    words = ["nes", "mine:Mine-v0"]
    if command == "evaluate":
        words = ["evaluate", "se.safetensors", "--task", "mine:Mine-v0"]
        se = make_se(replace(get_task("CartPole-v0"), step_limit=9, solved_reward=8.0))
        save_se(replace(se, task_id="mine:Mine-v0"), tmp_path / "se.safetensors")
    result = subprocess.run(
        [BILEVEL, *words],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        check=False,
    )
    assert result.returncode == 2, result.stderr
    place = f"{tmp_path / 'mine.py'}:7, when it takes a step: RuntimeError: the simulator broke"
    assert result.stderr == f"bilevel: task 'mine:Mine-v0' at {place}\n"
    written = {path.name for path in tmp_path.iterdir()}
    assert written <= {"mine.py", "se.safetensors", "__pycache__"}


def test_a_default_name_is_one_that_is_allowed(tmp_path: Path) -> None:
    """Whatever the file of its space or recipe is called."""
    space, recipe = tmp_path / "my space.json", tmp_path / "(mine).toml"
    CS.ConfigurationSpace(space=[CS.Float("nes.std_dev", (0.1, 0.3))]).to_json(space)
    recipe.write_text((RECIPES / "default.toml").read_text())
    files = ("--space", space, "--recipe", recipe, "--home", tmp_path / "home")
    result = run_bilevel("bohb", "CartPole-v0", "--profile", "smoke", "--dry-run", *files)
    assert result.returncode == 0, result.stderr
