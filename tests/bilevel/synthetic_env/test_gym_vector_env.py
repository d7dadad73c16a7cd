"""The vector environment gives what single ones give."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from bilevel import InvalidInput
from bilevel.hyperparameters import load_recipe
from bilevel.synthetic_env import SEDistribution, StoredSE, coordinates, save_se
from bilevel.tasks import get_task

ENV = "bilevel/SyntheticEnv-v0"
COPIES = 5


@pytest.fixture(params=["CartPole-v0", "Acrobot-v1"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """An SE whose episodes end in both ways."""
    task = get_task(request.param)
    space = coordinates(task, load_recipe("default", task.id).se, task.observation_scale(1))
    theta = space.initialize(np.random.default_rng(0))
    se = SEDistribution(space, theta, theta, theta).centre
    save_se(StoredSE(se, task.id, task.step_limit, task.solved_reward), tmp_path / "se.safetensors")
    return tmp_path / "se.safetensors"


@pytest.mark.parametrize("seed", [3, [9, 8, 7, 6, 5]])
def test_it_is_gymnasiums_loop_over_single_ones(path: Path, seed: int | list[int]) -> None:
    batched = gymnasium.make_vec(ENV, num_envs=COPIES, path=path)
    looped = gymnasium.make_vec(ENV, num_envs=COPIES, vectorization_mode="sync", path=path)
    assert type(batched.unwrapped) is not type(looped.unwrapped)
    assert batched.observation_space == looped.observation_space
    assert batched.action_space == looped.action_space
    any_seed: Any = seed  # gymnasium annotates one int alone
    states = [env.reset(seed=any_seed)[0] for env in (batched, looped)]
    np.testing.assert_array_equal(*states)
    rng, ended = np.random.default_rng(0), set[str]()
    for _ in range(150):
        actions = rng.integers(2, size=COPIES)
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
    assert ended


def test_actions_of_any_kind_and_wrong_ones(path: Path) -> None:
    single = gymnasium.make(ENV, path=path)
    single.reset(seed=0)
    for action in (1, np.int32(1), np.uint8(1), np.array(1), torch.tensor(1)):
        single.step(action)
    batched = gymnasium.make_vec(ENV, num_envs=2, path=path)
    batched.reset(seed=0)
    batched.step(torch.tensor([0, 1]))
    for wrong in (-1, 9, 0.5, "left"):
        with pytest.raises(InvalidInput, match=r"is not allowed: allowed are 0 to [12]$"):
            single.step(wrong)
        with pytest.raises(InvalidInput, match=r"is not allowed: allowed are 0 to [12]$"):
            batched.step([wrong, 0])
