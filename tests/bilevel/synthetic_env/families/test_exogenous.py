"""Exogenous SEs are plain MLPs with the properties that the module describes."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from bilevel.errors import InvalidInput
from bilevel.evolution import Genotype
from bilevel.hyperparameters import SEHyperparameters
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SE, Family, StoredSE, family_of
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import get_task

TASKS = ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"]


def moved(task_id: str, seed: int = 0) -> SE:
    """Return a random SE that NES has moved a little."""
    task = get_task(task_id)
    family = family_of(task, load_recipe("exogenous", task_id).se, task.observation_scale(1))
    rng = np.random.default_rng(seed)
    genotype = family.initialize(rng) + 0.3 * rng.standard_normal(family.size, np.float32)
    return se_of(family, genotype)


def se_of(family: Family, genotype: Genotype) -> SE:
    return SE(family.architecture, family.psi(genotype))


def answers(task_id: str, se: SE, states: np.ndarray) -> list[np.ndarray]:
    """Return next states, rewards and raw done (n, A, ...) of states (n, S) for every action."""
    task = get_task(task_id)
    module = SEModule(StoredSE(se, task.id, task.step_limit, task.solved_reward))
    columns = []
    for action in range(task.action_size):
        actions = torch.full((len(states),), action)
        columns.append([o.numpy() for o in module(torch.from_numpy(states), actions)])
    return [np.stack(parts, axis=1) for parts in zip(*columns, strict=True)]


@pytest.mark.parametrize("task_id", TASKS)
@pytest.mark.parametrize("seed", [0, 1])
def test_actions_change_rewards_only(task_id: str, seed: int) -> None:
    task = get_task(task_id)
    scale = task.observation_scale(1)
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((50, task.state_size)).astype(np.float32)
    states = scale.mean + scale.deviation * noise
    states = np.vstack([scale.mean[None], states]).astype(np.float32)
    se = moved(task_id, seed)
    next_states, rewards, _ = answers(task_id, se, states)
    spread = np.abs(next_states - next_states[:, :1]).max(axis=0)
    assert (spread <= 1e-3 * scale.deviation).all()  # for all actions
    size = np.abs(rewards).max()
    assert size > 0.01
    np.testing.assert_allclose(rewards.mean(axis=1), 0.0, atol=1e-3 * size + 1e-4)
    # At the mean observation no action is better.
    np.testing.assert_allclose(rewards[0], 0.0, atol=1e-3 * size + 1e-4)
    assert np.ptp(rewards.argmax(axis=1)) > 0  # no action is best everywhere


@pytest.mark.parametrize("task_id", TASKS)
@pytest.mark.parametrize("spread", [0.9, 1.12, 1.3])
def test_states_of_random_ses_spread_in_all_directions(task_id: str, spread: float) -> None:
    """Near the mean observation a step scales x by `se.spread` and rotates it."""
    task = get_task(task_id)
    scale = task.observation_scale(1)
    hp = replace(load_recipe("exogenous", task_id).se, spread=spread)
    family = family_of(task, hp, scale)
    directions = 1e-2 * np.eye(task.state_size)
    states = scale.mean + scale.deviation * np.vstack([directions, -directions])
    smallest = []
    for seed in range(5):
        genotype = family.initialize(np.random.default_rng(seed))
        se = se_of(family, genotype)
        next_states, _, _ = answers(task_id, se, states.astype(np.float32))
        x = (next_states[:, 0] - scale.mean) / scale.deviation
        step = (x[: task.state_size] - x[task.state_size :]).T / 2e-2  # x -> step @ x
        np.testing.assert_allclose(np.linalg.svd(step, compute_uv=False), spread, rtol=0.02)
        angles = np.sort(np.degrees(np.abs(np.angle(np.linalg.eigvals(step)))))
        assert angles[0] > 17
        assert angles[-1] < 163
        assert np.diff(angles[::2]).min(initial=90) > 1  # one pair per plane, no two alike
        smallest.append(angles[0])
    assert np.ptp(smallest) > 5  # the genotype determines the angles


@pytest.mark.parametrize("size", [1, 3, 5])
def test_one_of_an_odd_number_of_observations_changes_its_sign(size: int) -> None:
    task = replace(get_task("CartPole-v0"), state_size=size)
    hp = replace(load_recipe("exogenous", task.id).se, spread=1.0)
    family = family_of(task, hp, task.unit_scale)
    genotype = family.initialize(np.random.default_rng(0))
    se = se_of(family, genotype)
    module = SEModule(StoredSE(se, task.id, task.step_limit, task.solved_reward))
    x = 1e-2 * np.eye(size, dtype=np.float32)
    states = torch.from_numpy(np.vstack([x, -x]))
    next_states = module(states, torch.zeros(2 * size, dtype=torch.int64))[0].numpy()
    step = (next_states[:size] - next_states[size:]).T / 2e-2
    np.testing.assert_allclose(np.linalg.svd(step, compute_uv=False), 1.0, rtol=0.02)
    angles = np.sort(np.degrees(np.abs(np.angle(np.linalg.eigvals(step)))))
    assert angles[-1] == pytest.approx(180)
    assert ((angles[:-1] > 17) & (angles[:-1] < 163)).all()


@pytest.mark.parametrize("task_id", TASKS)
def test_episodes_end_outside_the_box_of_usual_observations(task_id: str) -> None:
    task = get_task(task_id)
    scale = task.observation_scale(1)
    family = family_of(task, load_recipe("exogenous", task_id).se, scale)
    genotype = family.initialize(np.random.default_rng(0))
    se = se_of(family, genotype)
    inside = scale.mean + 0.5 * scale.deviation
    for component in range(task.state_size):
        for side in (-1, 1):
            outside = inside.copy()
            outside[component] = scale.mean[component] + side * 2.5 * scale.deviation[component]
            states = np.stack([inside, outside]).astype(np.float32)
            _, _, dones = answers(task_id, se, states)
            assert (dones[0] < 0.5).all()
            assert (dones[1] > 0.5).all()


def test_plain_genotypes_are_psi() -> None:
    task = get_task("CartPole-v0")
    family = family_of(task, load_recipe("paper", task.id).se, task.unit_scale)
    genotype = family.initialize(np.random.default_rng(0))
    assert family.psi(genotype) is genotype
    assert family.size == family.architecture.parameter_count
    assert family.architecture.step_limit == task.step_limit


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"activation": "relu"}, "activation tanh"),
        ({"hidden_layers": 2}, "hidden_layers 1"),
    ],
)
def test_unsuitable_networks(changes: dict[str, object], message: str) -> None:
    task = get_task("CartPole-v0")
    hp: SEHyperparameters = replace(load_recipe("exogenous", task.id).se, **changes)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match=message):
        family_of(task, hp, task.unit_scale)
