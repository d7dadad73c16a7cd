"""The public API of `bilevel`: a run in one call, and an explicit loop."""

import subprocess
import sys
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import bilevel
from bilevel import InvalidInput
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks.task import SCALE_STEPS


def small(task_id: str) -> Hyperparameters:
    """The default recipe, with a few short evaluations."""
    hp = bilevel.load_recipe("default", task_id)
    agent = replace(hp.agents[0], init_episodes=9, max_episodes=12, test_episodes=1)
    nes = replace(
        hp.nes,
        start_candidates=4,
        population_size=2,
        centre_agents=2,
        patient_episodes=11,
        generations=2,
    )
    return replace(hp, agents=(agent,), nes=nes)


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_the_explicit_loop(task_id: str, tmp_path: Path) -> None:
    """Results may arrive in any order, and the saved SE is a gymnasium environment."""
    task = bilevel.get_task(task_id)
    final = []
    for order in (1, -1):
        nes = bilevel.NES(task, small(task_id), seed=3)
        state = nes.init()
        while not state.finished:
            ses = nes.distribution(state)
            results = [bilevel.evaluate(task, ses, request) for request in nes.ask(state)]
            state = nes.tell(state, results[::order])
        final.append(state)
    first, second = final
    np.testing.assert_array_equal(first.search.mean, second.search.mean)
    assert first.real_env_steps == second.real_env_steps > SCALE_STEPS

    path = tmp_path / "se.safetensors"
    bilevel.save(nes.best(state), path)
    stored = bilevel.load(str(path))
    np.testing.assert_array_equal(stored.psi, nes.best(state).psi)
    assert stored.info["real_env_steps"] == state.real_env_steps
    assert stored.info["hyperparameters"]["recipe"] == "default"
    assert stored.info["confirmed"] is state.confirmed is False
    with gymnasium.make("bilevel/SyntheticEnv-v0", path=path) as env:
        assert env.reset(seed=0)[0].shape == (task.state_size,)


@pytest.mark.parametrize("workers", [1, 2])
def test_learn_gives_the_same_se_on_every_executor(workers: int) -> None:
    generations: list[int] = []
    se = bilevel.learn(
        "CartPole-v0",
        small("CartPole-v0"),
        seed=3,
        workers=workers,
        on_generation=lambda record: generations.append(record.generation),
    )
    assert generations == [0, 1]
    threads: Executor
    with ThreadPoolExecutor(2) as threads:
        task = bilevel.get_task("CartPole-v0")
        other = bilevel.learn(task, small("CartPole-v0"), seed=3, executor=threads)
        assert threads.submit(int).result() == 0  # the executor stays open
    np.testing.assert_array_equal(se.psi, other.psi)
    assert se.info == other.info


def test_workers_use_agents_and_tasks_of_the_script(tmp_path: Path) -> None:
    """The script needs no main guard, and no worker imports it."""
    script = tmp_path / "script.py"
    script.write_text(
        """
from dataclasses import replace

import gymnasium
from gymnasium.envs.classic_control import CartPoleEnv

import bilevel
from bilevel.agents import AgentHyperparameters, hyperparameters, register_agent


class Here(CartPoleEnv):
    pass


@hyperparameters
class MyHyperparameters(AgentHyperparameters, agent="mine"):
    max_episodes: int = 11


class Mine:
    __init__ = lambda self, hp, state_size, action_size, seed: None
    act = lambda self, state, exploring: 1
    greedy = lambda self, state: 0
    observe = lambda self, transition: None
    learn = lambda self: 0.0
    end_episode = lambda self: None


gymnasium.register("Here-v0", entry_point=Here, max_episode_steps=5, reward_threshold=4.0)
register_agent(MyHyperparameters, Mine)
hp = bilevel.load_recipe("default", "Here-v0", ["mine"])
few = replace(hp.nes, start_candidates=1, population_size=1, centre_agents=1, generations=1)
se = bilevel.learn("Here-v0", replace(hp, nes=few, vary_agent="no"), workers=2)
print(se.task_id, se.info["score_mean"])
"""
    )
    result = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert (result.stdout, result.returncode) == ("Here-v0 5.0\n", 0), result.stderr


def test_importing_loads_neither_compiler_nor_torch() -> None:
    script = "import sys, bilevel; print(sorted({'numba', 'torch', 'ray'} & set(sys.modules)))"
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert result.stdout == "[]\n"


@pytest.mark.parametrize("workers", [0, 1.5, None])
def test_workers_is_a_positive_integer(workers: Any) -> None:
    message = rf"workers must be an integer of at least 1; got {workers!r}"
    with pytest.raises(InvalidInput, match=message):
        bilevel.learn("CartPole-v0", workers=workers)


def test_arguments_of_another_type() -> None:
    name: Any = "CartPole-v0"
    task, hp = bilevel.get_task(name), small(name)
    request = bilevel.NES(task, hp).ask(bilevel.NES(task, hp).init())[0]
    calls: dict[str, Any] = {
        r"must be a Task, as .*get_task.*; got 'CartPo": lambda: bilevel.NES(name, hp),
        "must be a Hyperparameters, as .*load_recipe": lambda: bilevel.NES(task, name),
        "of an evaluation must be a Task": lambda: bilevel.evaluate(name, None, request),
        "executor must be an Executor, as": lambda: bilevel.learn(task, hp, executor=name),
    }
    for message, call in calls.items():
        with pytest.raises(InvalidInput, match=message):
            call()
