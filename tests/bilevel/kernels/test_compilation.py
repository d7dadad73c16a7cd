"""Results do not depend on compiling or loading kernels, nor on the order of agents."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bilevel.agents import get_agent
from bilevel.compile import compile_agent
from bilevel.hyperparameters import default_agents
from bilevel.kernels import ddqn

PROGRAM = "from tests.bilevel.kernels.test_compilation import parameters; print(parameters())"


def parameters() -> str:
    """The parameters of a DDQN agent after ten gradient steps."""
    hp: Any
    (hp,) = default_agents(("ddqn",))
    hp = replace(hp, hidden_size=31, batch_size=50)
    build = get_agent("ddqn").build_kernel
    assert build is not None
    kernel, rng = build(hp, 4, 2, np.random.default_rng(0)), np.random.default_rng(1)
    batch, size = kernel.batch, hp.batch_size
    for _ in range(10):
        batch.states[:], batch.next_states[:] = rng.normal(0, 1, (2, *batch.states.shape))
        batch.rewards[:], batch.dones[:] = rng.normal(0, 1, size), 0.0
        batch.actions[:, :size] = rng.integers(0, 2, size)
        ddqn.gradient_step(kernel)
    return str(kernel.parameters()[0].tobytes().hex())


def printed(cache: Path) -> str:
    """The parameters in a process with this folder of compiled kernels."""
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=Path(__file__).parents[3],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.strip()


def test_results_do_not_depend_on_what_the_process_compiled(tmp_path: Path) -> None:
    compiled = printed(tmp_path)
    assert printed(tmp_path) == compiled  # loaded
    compile_agent("td3", continuous=False)  # inlines some of the same functions
    compile_agent("ddqn", continuous=False)
    assert parameters() == compiled
