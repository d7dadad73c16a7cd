"""Results do not depend on compiling or loading kernels, nor on the order of agents."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
from dataclasses import replace
import numpy as np
from bilevel.evaluation import train_and_test
from bilevel.recipes import load_recipe
from bilevel.kernels import training
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import get_task

task = get_task("CartPole-v0")
for name in sys.argv[1:]:
    hp = load_recipe("paper", "", (name,))
    agent = replace(hp.agents[0], max_episodes=6, init_episodes=1, hidden_size=31, batch_size=50)
    architecture = Architecture.of(task, hp.se)
    psi = architecture.initialize(np.random.default_rng(0))
    kept = []
    train = training.train
    training.train = lambda kernel, *others: (kept.append(kernel), train(kernel, *others))[1]
    train_and_test(task, SE(architecture, psi), agent, 3)
    training.train = train
    print(name, kept[0].parameters()[0].tobytes().hex()[:200])
"""


def parameters(root: Path, *agents: str) -> set[str]:
    """The parameters after a process has trained the agents in that order."""
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, *agents],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=True,
    )
    return set(run.stdout.splitlines())


@pytest.mark.timeout(280)
def test_results_do_not_depend_on_what_the_process_compiled(tmp_path: Path) -> None:
    here = Path(__file__).parents[3]
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(here / "bilevel", tmp_path / "bilevel", ignore=ignored)
    compiled_alone = parameters(tmp_path, "ddqn")
    loaded = parameters(here, "td3", "ddqn")  # compiled by `make setup`
    assert len(compiled_alone) == 1
    assert compiled_alone < loaded
