"""SEs of tasks with all kinds of spaces, as gymnasium environments."""

from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.utils.env_checker import check_env

from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SE, StoredSE, family_of, load_se, save_se
from bilevel.tasks import get_task
from tests.envs import CustomEnv, register_env
from tests.ses import make_se

ENV = "bilevel/SyntheticEnv-v0"

DICT = Dict({"place": Discrete(3), "speed": Box(-1, 1, (2,), np.float64)})


def place_and_speed(rng: np.random.Generator) -> Any:
    return {"place": rng.integers(3), "speed": rng.uniform(-1, 1, 2)}


@pytest.fixture(params=["Pendulum-v1", "MountainCarContinuous-v0", "FrozenLake-v1", "Dict"])
def path(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """File of an SE: of one step for continuous actions, else plain."""
    name = request.param
    if name == "Dict":
        name = register_env(monkeypatch, partial(CustomEnv, observe=place_and_speed, space=DICT))
    task = get_task(name)
    se = make_se(task)
    if task.continuous:
        family = family_of(task, load_recipe("default", task).se, task.observation_scale(0))
        own = SE(family.architecture, family.psi(family.initialize(np.random.default_rng(0))))
        se = StoredSE(own, task.id, task.step_limit, task.solved_reward)
    save_se(se, tmp_path / "se.safetensors")
    return tmp_path / "se.safetensors"


@pytest.mark.filterwarnings("ignore:.*(Box observation space|Box action space).*:UserWarning")
def test_it_passes_the_checker_and_has_the_spaces_of_the_task(path: Path) -> None:
    env = gymnasium.make(ENV, path=path)
    check_env(env.unwrapped, skip_render_check=True)
    real = load_se(path).task().make()
    assert env.observation_space == real.observation_space
    assert env.action_space == real.action_space


def test_batched_equals_looped(path: Path) -> None:
    batched: Any = gymnasium.make_vec(ENV, num_envs=3, path=path)
    looped: Any = gymnasium.make_vec(ENV, num_envs=3, vectorization_mode="sync", path=path)
    batched.reset(seed=5)
    looped.reset(seed=5)
    batched.action_space.seed(0)
    for _ in range(20):
        actions = batched.action_space.sample()
        (states, rewards, *_), (expected, expected_rewards, *_) = (
            env.step(actions) for env in (batched, looped)
        )
        np.testing.assert_allclose(rewards, expected_rewards, rtol=1e-3, atol=1e-4)
        if isinstance(batched.single_observation_space, Box):
            np.testing.assert_allclose(states, expected, rtol=1e-3, atol=1e-4)
        assert batched.observation_space.contains(states)


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Pendulum-v1"])
def test_an_agent_moves_between_se_and_real_task(task_id: str, tmp_path: Path) -> None:
    from stable_baselines3 import PPO

    task = get_task(task_id)
    save_se(make_se(task), tmp_path / "se.safetensors")
    agent = PPO("MlpPolicy", gymnasium.make(ENV, path=tmp_path / "se.safetensors"), n_steps=64)
    agent.learn(64)
    agent.set_env(task.make())
    agent.learn(64)
