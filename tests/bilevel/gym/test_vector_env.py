"""The vector environment equals a loop over single environments."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from bilevel import InvalidInput
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SE, StoredSE, family_of, save_se
from bilevel.tasks import get_task

ENV = "bilevel/SyntheticEnv-v0"
COPIES = 5


@pytest.fixture(params=["CartPole-v0", "Acrobot-v1"])
def task_id(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=[60, 5, 1], ids=["terminated", "truncated", "one step"])
def step_limit(request: pytest.FixtureRequest) -> int:
    """With the first limit, episodes terminate; with the second, they are truncated. With the last
    one, they terminate at the limit."""
    return int(request.param)


@pytest.fixture
def path(task_id: str, step_limit: int, tmp_path: Path) -> Path:
    """File of a random SE."""
    task = get_task(task_id)
    recipe = "default" if step_limit == 1 else "exogenous"
    hp = replace(load_recipe(recipe, task.id).se, step_limit=step_limit)
    family = family_of(task, hp, task.observation_scale(1))
    se = SE(family.architecture, family.psi(family.initialize(np.random.default_rng(0))))
    save_se(StoredSE(se, task.id, task.step_limit, task.solved_reward), tmp_path / "se.safetensors")
    return tmp_path / "se.safetensors"


@pytest.mark.parametrize("seed", [3, np.int64(3), [9, 8, 7, 6, 5]])
def test_equals_a_loop_over_single_environments(path: Path, step_limit: int, seed: Any) -> None:
    batched: Any = gymnasium.make_vec(ENV, num_envs=COPIES, path=path)
    looped: Any = gymnasium.make_vec(ENV, num_envs=COPIES, vectorization_mode="sync", path=path)
    assert type(batched.unwrapped) is not type(looped.unwrapped)
    assert batched.observation_space == looped.observation_space
    assert batched.action_space == looped.action_space
    seeds = seed if isinstance(seed, list) else int(seed)
    np.testing.assert_array_equal(batched.reset(seed=seed)[0], looped.reset(seed=seeds)[0])
    rng, ends = np.random.default_rng(0), np.zeros(2, bool)
    for _ in range(300):
        actions = rng.integers(batched.single_action_space.n, size=COPIES)
        ours, expected = batched.step(actions), looped.step(actions)
        for i in range(2):  # observations and rewards
            np.testing.assert_allclose(ours[i], expected[i], rtol=1e-2, atol=1e-3)
        for i in (2, 3):  # terminated and truncated
            np.testing.assert_array_equal(ours[i], expected[i])
            ends[i - 2] |= expected[i].any()
        stepped = expected[4].get("_done", np.zeros(COPIES, bool))
        np.testing.assert_array_equal(ours[4]["_done"], stepped)
        done = np.where(stepped, expected[4].get("done", 0.0), 0.0)
        np.testing.assert_allclose(ours[4]["done"], done, rtol=1e-2, atol=1e-3)
    assert ends[1 if step_limit == 5 else 0]
    assert step_limit > 1 or not ends[1]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda env: env.reset(seed=[1, 2]), "2 seeds for 3 copies"),
        (lambda env: env.step([0, 1]), r"actions must be 3 elements of Discrete"),
        (lambda env: env.step(0), r"actions must be 3 elements of Discrete"),
    ],
)
def test_other_numbers_of_seeds_and_actions(call: Any, message: str, se_file: Path) -> None:
    env = gymnasium.make_vec(ENV, num_envs=3, path=se_file).unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        call(env)


def test_actions_are_integers_of_any_type(se_file: Path) -> None:
    single: Any = gymnasium.make(ENV, path=se_file)
    batched: Any = gymnasium.make_vec(ENV, num_envs=2, path=se_file)
    single.reset(seed=0)
    batched.reset(seed=0)
    for action in (1, np.int32(1), np.uint8(1), np.array(1), torch.tensor(1)):
        single.step(action)
    batched.step(torch.tensor([0, 1]))
    for wrong in (-1, 2, 0.5, "left"):
        for take in (single.step, lambda action: batched.step([0, action])):
            with pytest.raises(InvalidInput, match=r"are 0 to 1$|must be 2 elements of Discrete"):
                take(wrong)
