"""The documentation builds without warnings, its commands and paths exist, and its code runs.

The code of docs/agents.md, se-files.md and zoo.md runs in the tests of these features.
"""

import importlib.util
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import click
import pytest

from bilevel import load_recipe
from cluster.cli.program import cli
from tests.commands import BILEVEL, run_bilevel
from tests.documents import DOCUMENTS, ROOT, commands, inline_code, python_blocks, toml_block

pytestmark = pytest.mark.timeout(200)

all_documents = pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)


def test_site_builds(tmp_path: Path) -> None:
    """Sphinx reports no broken links; links in README lead to pages of the site."""
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    built = subprocess.run(
        [*command, ROOT / "docs", tmp_path], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    page = (tmp_path / "using.html").read_text()
    assert 'href="tuning.html"' in page
    assert 'href="docs/' not in page


@all_documents
def test_commands_exist(document: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    for words in commands(document):
        if words[0] == "make" and len(words) > 1 and "=" not in words[1]:
            assert words[1] in targets, words
        if words[:2] == ["python", "-m"] and words[2].startswith("benchmarks"):
            assert importlib.util.find_spec(words[2]), words
        for position, word in enumerate(words[:-1]):
            if re.fullmatch("(.*bin/)?bilevel", word) and words[position + 1][0] != "-":
                require_command(words[position + 1 :])


def require_command(words: list[str]) -> None:
    """Fail unless the command and all of its options exist."""
    command: click.Command = cli
    while isinstance(command, click.Group) and words and words[0] in command.commands:
        command, words = command.commands[words[0]], words[1:]
    assert command is not cli, words
    known = {option for param in command.params for option in param.opts}
    assert {word for word in words if word.startswith("--")} - known - {"--help"} == set(), words


@all_documents
def test_paths_exist(document: Path) -> None:
    folders = ("bilevel", "search_spaces", "cluster", "tests", "benchmarks", "docs")
    for code in inline_code(document):
        is_path = re.fullmatch(rf"({'|'.join(folders)})/[\w./-]+", code)
        if is_path and not code.startswith("bilevel/Synthetic"):  # an environment's id
            assert (ROOT / code).exists(), code


def test_tutorial(tmp_path: Path) -> None:
    """An SE learned by one script is used by other processes."""
    zoo, task, learn, train = python_blocks("docs/tutorial.md")
    (tmp_path / "balance.py").write_text(task)
    (tmp_path / "learn.py").write_text(f"{zoo}\n{learn}")
    (tmp_path / "train.py").write_text(train)
    scores = re.findall(r"^generation .* score +(\d+\.\d+) ", output_of("learn.py", tmp_path), re.M)
    assert float(scores[-1]) >= 95  # this task is solved within seconds
    assert float(output_of("train.py", tmp_path)) > 50  # repeating one action scores 12
    show = ("show", "balance_se.safetensors")
    assert run_bilevel(*show, cwd=tmp_path).returncode == 2
    assert run_bilevel(*show, "--task", "CartPole-v0", cwd=tmp_path).returncode == 2
    command = [BILEVEL, *show, "--task", "balance:Balance-v0"]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([".", str(ROOT)])}
    subprocess.run(command, cwd=tmp_path, check=True, env=env)
    assert (tmp_path / "balance_se.png").exists()


def output_of(script: str, folder: Path) -> str:
    """Run a script in a folder and return its output."""
    # On busy cores, several torch threads slow each other down.
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, script]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=env)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_recipe_that_extends_another(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(toml_block("docs/recipes.md"))
    default = load_recipe("default", "CartPole-v0")
    nes, se = replace(default.nes, population_size=24), replace(default.se, hidden_size=32)
    mine = load_recipe(tmp_path / "mine.toml", "CartPole-v0")
    assert mine == replace(default, nes=nes, se=se, recipe="mine")


def test_tasks_and_a_policy(tmp_path: Path) -> None:
    (tmp_path / "policy.py").write_text("\n".join(python_blocks("docs/tasks.md")))
    assert -125 < float(output_of("policy.py", tmp_path)) < -115


SMALL = """extends = "default"
[nes]
start_candidates = 2
generations = 1
centre_agents = 2
population_size = 2
"""


def test_readme(tmp_path: Path) -> None:
    """The code of the README runs, here with a small recipe."""
    (tmp_path / "small.toml").write_text(SMALL)
    code = "\n".join(python_blocks("README.md"))
    code = code.replace("seed=0, workers=2", 'recipe="small.toml", seed=0, workers=2')
    code = code.replace('load_recipe("default"', 'load_recipe("small.toml"')
    assert code.count("small.toml") == 2
    code += '\nprint(rewards.shape, env.spec.id, "nes.std_dev" in space)'
    (tmp_path / "readme.py").write_text(code)
    generation, *rest = output_of("readme.py", tmp_path).splitlines()
    assert generation.startswith("generation   0  score ")
    assert rest == ["False", "torch.Size([3]) bilevel/SyntheticEnv-v0 True"]
    assert (tmp_path / "my_space.json").exists()
