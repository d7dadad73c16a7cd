"""Compiled here or loaded from disk, first this agent or first that: the same numbers."""

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
from bilevel.hyperparameters import load_preset
from bilevel.kernels import training
from bilevel.synthetic_env import Architecture
from bilevel.tasks import get_task

task = get_task("CartPole-v0")
for name in sys.argv[1:]:
    hp = load_preset("default", task.id, agents=(name,))
    agent = replace(hp.agents[0], max_episodes=6, init_episodes=1, hidden_size=31, batch_size=50)
    architecture = Architecture.of(task, hp.se)
    psi = architecture.initialize(np.random.default_rng(0))
    kept = []
    train = training.train
    training.train = lambda kernel, *others: (kept.append(kernel), train(kernel, *others))[1]
    train_and_test(task, (architecture, psi), agent, 3)
    training.train = train
    if name == "td3":
        print(name, kept[0].phi.online.tobytes().hex()[:200])
    else:
        print(name, kept[0].theta.tobytes().hex()[:200])
"""


@pytest.mark.timeout(280)
def test_results_do_not_depend_on_what_the_process_compiled(tmp_path: Path) -> None:
    source = Path(__file__).parents[3] / "bilevel"
    shutil.copytree(source, tmp_path / "bilevel", ignore=shutil.ignore_patterns("__pycache__"))

    def parameters(*agents: str) -> set[str]:
        run = subprocess.run(
            [sys.executable, "-c", PROGRAM, *agents],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        return set(run.stdout.splitlines())

    compiled_here = parameters("ddqn", "td3")
    assert len(compiled_here) == 2
    assert parameters("td3", "ddqn") == compiled_here  # loaded from disk, in another order
