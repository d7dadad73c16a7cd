"""The vector environment gives what single ones give."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from bilevel import InvalidInput
from bilevel.gym.vector_env import SyntheticVectorEnv
from bilevel.hyperparameters import load_recipe
from bilevel.synthetic_env import SEDistribution, StoredSE, coordinates, save_se
from bilevel.tasks import get_task

ENV = "bilevel/SyntheticEnv-v0"
COPIES = 5


@pytest.fixture(params=["CartPole-v0", "Acrobot-v1"])
def task_id(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=[60, 5])
def step_limit(request: pytest.FixtureRequest) -> int:
    """Of the first, episodes end by themselves; of the second, they are cut."""
    return int(request.param)


@pytest.fixture
def path(task_id: str, step_limit: int, tmp_path: Path) -> Path:
    """A random SE."""
    task = get_task(task_id)
    hp = replace(load_recipe("default", task.id).se, step_limit=step_limit)
    space = coordinates(task, hp, task.observation_scale(1))
    theta = space.initialize(np.random.default_rng(0))
    se = SEDistribution(space, theta, theta, theta).centre
    save_se(StoredSE(se, task.id, task.step_limit, task.solved_reward), tmp_path / "se.safetensors")
    return tmp_path / "se.safetensors"


@pytest.mark.parametrize("seed", [3, [9, 8, 7, 6, 5]])
def test_it_is_gymnasiums_loop_over_single_ones(
    path: Path, step_limit: int, seed: int | list[int]
) -> None:
    batched = gymnasium.make_vec(ENV, num_envs=COPIES, path=path)
    looped = gymnasium.make_vec(ENV, num_envs=COPIES, vectorization_mode="sync", path=path)
    assert type(batched.unwrapped) is not type(looped.unwrapped)
    assert batched.observation_space == looped.observation_space
    assert batched.action_space == looped.action_space
    any_seed: Any = seed  # gymnasium annotates one int alone
    states = [env.reset(seed=any_seed)[0] for env in (batched, looped)]
    np.testing.assert_array_equal(*states)
    rng, ended = np.random.default_rng(0), set[str]()
    n_actions = batched.single_action_space.n  # type: ignore[attr-defined]
    for _ in range(300):
        actions = rng.integers(n_actions, size=COPIES)
        ours, theirs = batched.step(actions), looped.step(actions)
        for one, other in zip(ours[:2], theirs[:2], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-2, atol=1e-3)
        for one, other, how in zip(ours[2:4], theirs[2:4], ("ended", "cut"), strict=True):
            np.testing.assert_array_equal(one, other)
            ended |= {how} if other.any() else set()
        stepped = theirs[4].get("_done", np.zeros(COPIES, bool))
        np.testing.assert_array_equal(ours[4]["_done"], stepped)
        done = np.where(stepped, theirs[4].get("done", 0.0), 0.0)
        np.testing.assert_allclose(ours[4]["done"], done, rtol=1e-2, atol=1e-3)
    assert ("ended" if step_limit == 60 else "cut") in ended


def test_a_mask_resets_some_copies_and_wrong_numbers_are_refused(path: Path) -> None:
    env: Any = gymnasium.make_vec(ENV, num_envs=3, path=path).unwrapped
    env.reset(seed=0)
    before = env.step([0, 0, 0])[0]
    mask = np.array([False, True, False])
    after, _ = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal((after == before).all(axis=1), ~mask)
    for no_mask in ([True], True, np.array([0]), [0, 2, 1], [[True, False, True]]):
        with pytest.raises(InvalidInput, match="reset_mask must be 3 booleans, one a copy"):
            env.reset(options={"reset_mask": no_mask})
    np.testing.assert_array_equal(env.reset(options={"reset_mask": [False] * 3})[0], after)
    with pytest.raises(ValueError, match="2 seeds for 3 copies"):
        env.reset(seed=[1, 2])
    for wrong in ([0, 1], np.zeros((3, 1), int), 0):
        with pytest.raises(InvalidInput, match=r"actions of the shape \(.*\) for 3 copies"):
            env.step(wrong)
    with pytest.raises(InvalidInput, match="num_envs must be at least 1; got 0"):
        SyntheticVectorEnv(path, num_envs=0)
    with pytest.raises(InvalidInput, match=r"vectorization_mode=.sync."):
        gymnasium.make_vec(ENV, num_envs=2, path=path, render_mode="rgb_array")
    seeded = [env.reset(seed=seed)[0] for seed in (3, np.int64(3))]
    np.testing.assert_array_equal(*seeded)


def test_actions_of_any_kind_and_wrong_ones(path: Path) -> None:
    single = gymnasium.make(ENV, path=path)
    single.reset(seed=0)
    for action in (1, np.int32(1), np.uint8(1), np.array(1), torch.tensor(1)):
        single.step(action)
    batched = gymnasium.make_vec(ENV, num_envs=2, path=path)
    batched.reset(seed=0)
    batched.step(torch.tensor([0, 1]))
    for wrong in (-1, 9, 0.5, "left"):
        with pytest.raises(
            InvalidInput, match=r"is not allowed: allowed are the integers 0 to [12]$"
        ):
            single.step(wrong)
        with pytest.raises(
            InvalidInput, match=r"is not allowed: allowed are the integers 0 to [12]$"
        ):
            batched.step([wrong, 0])
