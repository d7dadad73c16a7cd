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
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks.task import SCALE_STEPS


def small(task_id: str) -> Hyperparameters:
    """The default recipe, with a few short evaluations."""
    hp = bilevel.load_recipe("default", task_id)
    agent = replace(hp.agents[0], max_episodes=12, test_episodes=1)
    few = replace(
        hp.nes,
        start_candidates=4,
        population_size=2,
        centre_agents=2,
        patient_episodes=11,
        generations=2,
    )
    return replace(hp, agents=(agent,), nes=few)


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_a_loop_of_ones_own(task_id: str, tmp_path: Path) -> None:
    """Results may come in any order; the saved SE is a gymnasium environment."""
    task = bilevel.get_task(task_id)
    ends = []
    for backwards in (False, True):
        nes = bilevel.NES(task, small(task_id), seed=3)
        state = nes.init()
        while not state.finished:
            results = [bilevel.evaluate(task, state.se, request) for request in nes.ask(state)]
            state = nes.tell(state, results[::-1] if backwards else results)
        ends.append(state)
    np.testing.assert_array_equal(ends[0].se.mean, ends[1].se.mean)
    assert (
        ends[0].real_env_steps == ends[1].real_env_steps > state.scale.real_env_steps == SCALE_STEPS
    )

    path = tmp_path / "se.safetensors"
    bilevel.save(state.best, path)
    stored = bilevel.load(str(path))
    np.testing.assert_array_equal(stored.psi, state.best.psi)
    assert stored.info["real_env_steps"] == state.real_env_steps
    assert stored.info["hyperparameters"]["recipe"] == "default"
    assert stored.info["confirmed"] is state.confirmed is False
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=path)
    observation, _ = env.reset(seed=0)
    assert observation.shape == (task.state_size,)
    env.close()


@pytest.mark.parametrize("workers", [1, 2])
def test_learning_in_one_call_gives_the_same_se_wherever_it_runs(workers: int) -> None:
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
        assert threads.submit(int).result() == 0  # it is left open
    np.testing.assert_array_equal(se.psi, other.psi)
    assert se.info == other.info


def test_a_script_needs_no_main_guard(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from dataclasses import replace\n"
        "import bilevel\n"
        "hp = bilevel.load_recipe('default', 'CartPole-v0')\n"
        "few = replace(hp.nes, start_candidates=1, population_size=1, centre_agents=1,\n"
        "    patient_episodes=11, generations=1)\n"
        "agent = replace(hp.agents[0], max_episodes=11)\n"
        "hp = replace(hp, nes=few, agents=(agent,))\n"
        "print(bilevel.learn('CartPole-v0', hp, workers=2).task_id)\n"
    )
    result = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert (result.stdout, result.returncode) == ("CartPole-v0\n", 0), result.stderr


def test_workers_know_what_the_script_has_registered(tmp_path: Path) -> None:
    """An agent and a task that are defined in the script itself, which no worker imports."""
    script = tmp_path / "script.py"
    script.write_text(
        """
from dataclasses import replace

import gymnasium
import numpy as np

import bilevel
from bilevel.agents import AgentHyperparameters, hyperparameters, register_agent


class Here(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-9.0, 9.0, (2,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.normal(size=2).astype(np.float32), {}

    def step(self, action):
        return self.np_random.normal(size=2).astype(np.float32), 1.0, False, False, {}


@hyperparameters
class MyHyperparameters(AgentHyperparameters, agent="mine"):
    max_episodes: int = 11


class Mine:
    def __init__(self, hp, state_size, n_actions, seed):
        pass

    def act(self, state, exploring):
        return 1

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


def test_every_public_name_is_there() -> None:
    for name in bilevel.__all__:
        assert getattr(bilevel, name)
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = bilevel.nonsense


@pytest.mark.parametrize("workers", [0, 1.5, "2", None, True])
def test_no_worker_is_too_few(workers: Any) -> None:
    told = rf"workers must be an integer of at least 1; got {workers!r}"
    with pytest.raises(bilevel.InvalidInput, match=told):
        bilevel.learn("CartPole-v0", workers=workers)


def test_values_of_another_kind_are_told() -> None:
    """By names that the commands take, and the Python functions do not."""
    name: Any = "CartPole-v0"
    task = bilevel.get_task(name)
    hp = small(name)
    request = bilevel.NES(task, hp).ask(bilevel.NES(task, hp).init())[0]
    with pytest.raises(bilevel.InvalidInput, match=r"must be a Task, as .*get_task.*; got 'CartPo"):
        bilevel.NES(name, hp)
    with pytest.raises(bilevel.InvalidInput, match=r"must be a Hyperparameters, as .*load_recipe"):
        bilevel.NES(task, name)
    with pytest.raises(bilevel.InvalidInput, match=r"task of an evaluation must be a Task"):
        bilevel.evaluate(name, None, request)
    with pytest.raises(bilevel.InvalidInput, match=r"training on .* needs .*on=RealTask\(\)"):
        bilevel.evaluate(task, None, request)
    with pytest.raises(bilevel.InvalidInput, match=r"agent of a request must be an AgentHyper"):
        bilevel.evaluate(task, None, replace(request, agent=name))
    environment: Any = gymnasium.make("CartPole-v1")
    with pytest.raises(bilevel.InvalidInput, match=r"task to learn must be a Task, as .*get_task"):
        bilevel.learn(environment)
    number: Any = 3
    with pytest.raises(bilevel.InvalidInput, match=r"in the zoo or MLflow.s address; got 3"):
        bilevel.load(number)
    with pytest.raises(bilevel.InvalidInput, match=r"solved reward must be a finite number; got"):
        bilevel.get_task("CartPole-v0", solved_reward=name)
    with pytest.raises(bilevel.InvalidInput, match=r"worst score .* must be finite and below"):
        bilevel.get_task("CartPole-v0", worst_score=name)
    assert [one.agent for one in bilevel.load_recipe("default", task, "td3").agents] == ["td3"]
    executor: Any = ThreadPoolExecutor
    with pytest.raises(bilevel.InvalidInput, match=r"ThreadPoolExecutor, not the class: call it"):
        bilevel.learn(task, hp, executor=executor)
