"""Exogenous SEs are plain MLPs with the structure that their docstring describes."""

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

import bilevel.tasks.task
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import SEHyperparameters, load_recipe
from bilevel.kernels import dynamics
from bilevel.synthetic_env import SE, SEDistribution, StoredSE, coordinates, load_se, save_se
from bilevel.synthetic_env.coordinates import ExogenousCoordinates
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import Task, get_task
from bilevel.tasks.task import SCALE_STEPS
from tests.documents import ROOT

TASKS = ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"]


def distribution(task_id: str, seed: int = 0) -> SEDistribution:
    """A search distribution around a random SE that NES has moved a little."""
    task = get_task(task_id)
    space = coordinates(task, load_recipe("default", task_id).se, task.observation_scale(1))
    rng = np.random.default_rng(seed)
    mean = space.initialize(rng) + 0.3 * rng.standard_normal(space.size, np.float32)
    return SEDistribution(space, mean, np.full(space.size, 0.1, np.float32), mean)


def answers(task_id: str, se: SE, states: np.ndarray) -> list[np.ndarray]:
    """Next states, rewards and raw done of states (n, S) for every action, (n, A, ...) each."""
    task = get_task(task_id)
    module = SEModule(StoredSE(se, task.id, task.step_limit, task.solved_reward))
    columns = []
    for action in range(task.n_actions):
        actions = torch.full((len(states),), action)
        columns.append([o.numpy() for o in module(torch.from_numpy(states), actions)])
    return [np.stack(parts, axis=1) for parts in zip(*columns, strict=True)]


@pytest.mark.parametrize("task_id", TASKS)
@pytest.mark.parametrize("seed", [0, 1])
def test_what_the_structure_promises(task_id: str, seed: int) -> None:
    task = get_task(task_id)
    scale = task.observation_scale(1)
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((50, task.state_size)).astype(np.float32)
    states = scale.mean + scale.deviation * noise
    states = np.vstack([scale.mean[None], states]).astype(np.float32)
    se = distribution(task_id, seed).centre
    next_states, rewards, _ = answers(task_id, se, states)
    spread = np.abs(next_states - next_states[:, :1]).max(axis=0)
    assert (spread <= 1e-3 * scale.deviation).all()  # whatever the action
    size = np.abs(rewards).max()
    assert size > 0.01
    np.testing.assert_allclose(rewards.mean(axis=1), 0.0, atol=1e-3 * size + 1e-4)
    # At the mean observation no action is better.
    np.testing.assert_allclose(rewards[0], 0.0, atol=1e-3 * size + 1e-4)
    assert np.ptp(rewards.argmax(axis=1)) > 0  # no action is the best everywhere


@pytest.mark.parametrize("task_id", TASKS)
def test_rewards_are_linear_apart_from_their_bends(task_id: str) -> None:
    """Also in the smallest networks that hold the structure, which may have no bends at all."""
    task = get_task(task_id)
    scale = task.observation_scale(1)
    least = 2 * max(task.n_actions, task.state_size)
    rng = np.random.default_rng(0)
    x = rng.standard_normal((20, task.state_size))
    states = [(scale.mean + k * scale.deviation * x).astype(np.float32) for k in (1.0, -1.5)]
    for size in (least, 27):
        hp = replace(load_recipe("default", task_id).se, hidden_size=size)
        space = coordinates(task, hp, scale)
        assert isinstance(space, ExogenousCoordinates)
        theta = space.initialize(rng)
        for straight in (False, True):
            if straight:
                space.parts(theta)["U"][...] = 0
            se = SEDistribution(space, theta, theta, theta).centre
            at, beyond = (answers(task_id, se, some)[1] for some in states)
            size_of = np.abs(at).max()
            assert size_of > 0.1
            bent = np.abs(beyond + 1.5 * at).max() > 0.01 * size_of
            assert bent == (not straight and space.parts(theta)["U"].size > 0)


@pytest.mark.parametrize("task_id", TASKS)
@pytest.mark.parametrize("spread", [0.9, 1.12, 1.3])
def test_states_of_random_ses_spread_in_all_directions(task_id: str, spread: float) -> None:
    """Near the mean observation a step makes x `se.spread` times as long, and turns it: nowhere
    does a component keep its sign for long."""
    task = get_task(task_id)
    scale = task.observation_scale(1)
    hp = replace(load_recipe("default", task_id).se, spread=spread)
    space = coordinates(task, hp, scale)
    directions = 1e-2 * np.eye(task.state_size)
    states = scale.mean + scale.deviation * np.vstack([directions, -directions])
    smallest = []
    for seed in range(5):
        theta = space.initialize(np.random.default_rng(seed))
        se = SEDistribution(space, theta, theta, theta).centre
        next_states, _, _ = answers(task_id, se, states.astype(np.float32))
        x = (next_states[:, 0] - scale.mean) / scale.deviation
        step = (x[: task.state_size] - x[task.state_size :]).T / 2e-2  # x -> step @ x
        np.testing.assert_allclose(np.linalg.svd(step, compute_uv=False), spread, rtol=0.02)
        angles = np.sort(np.degrees(np.abs(np.angle(np.linalg.eigvals(step)))))
        assert angles[0] > 17
        assert angles[-1] < 163
        assert np.diff(angles[::2]).min(initial=90) > 1  # one pair a plane, no two alike
        smallest.append(angles[0])
    assert np.ptp(smallest) > 5  # the angles are coordinates


@pytest.mark.parametrize("size", [1, 3, 5])
def test_of_an_odd_number_of_observations_one_changes_its_sign(size: int) -> None:
    task = replace(get_task("CartPole-v0"), state_size=size)
    hp = replace(load_recipe("default", task.id).se, spread=1.0)
    space = coordinates(task, hp, task.unit_scale)
    theta = space.initialize(np.random.default_rng(0))
    se = SEDistribution(space, theta, theta, theta).centre
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
    space = coordinates(task, load_recipe("default", task_id).se, scale)
    theta = space.initialize(np.random.default_rng(0))
    se = SEDistribution(space, theta, theta, theta).centre
    inside = scale.mean + 0.5 * scale.deviation
    for component in range(task.state_size):
        for side in (-1, 1):
            outside = inside.copy()
            outside[component] = scale.mean[component] + side * 2.5 * scale.deviation[component]
            states = np.stack([inside, outside]).astype(np.float32)
            _, _, dones = answers(task_id, se, states)
            assert (dones[0] < 0.5).all()
            assert (dones[1] > 0.5).all()


def test_the_file_is_that_of_a_plain_se(tmp_path_factory: pytest.TempPathFactory) -> None:
    task, path = get_task("CartPole-v0"), tmp_path_factory.mktemp("se") / "se.safetensors"
    se = distribution(task.id).centre
    save_se(StoredSE(se, task.id, task.step_limit, task.solved_reward), path)
    loaded = load_se(path)
    assert loaded.architecture == se.architecture
    np.testing.assert_array_equal(loaded.psi, se.psi)
    assert loaded.architecture.step_limit == load_recipe("default", task.id).se.step_limit


def test_plain_coordinates_are_the_parameters() -> None:
    task = get_task("CartPole-v0")
    space = coordinates(task, load_recipe("paper", task.id).se, task.unit_scale)
    theta = space.initialize(np.random.default_rng(0))
    assert space.psi(theta) is theta
    assert space.size == space.architecture.parameter_count
    assert space.architecture.step_limit == task.step_limit


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hidden_size": 7}, "hidden_size of at least 8"),
        ({"activation": "relu"}, "activation tanh"),
        ({"hidden_layers": 2}, "hidden_layers 1"),
    ],
)
def test_networks_that_cannot_hold_the_structure(changes: dict[str, object], message: str) -> None:
    task = get_task("CartPole-v0")
    hp: SEHyperparameters = replace(load_recipe("default", task.id).se, **changes)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match=message):
        coordinates(task, hp, task.unit_scale)


def test_the_scale_of_observations_is_that_of_random_episodes() -> None:
    task = get_task("CartPole-v0")
    one, two, other = (task.observation_scale(seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.deviation, two.deviation)
    assert not np.array_equal(one.deviation, other.deviation)
    assert one.real_env_steps == SCALE_STEPS
    assert 0.3 < one.deviation[1] < 0.9  # a cart's velocity in units a second


def test_the_scale_of_a_task_that_gymnasium_runs_takes_fewer_steps() -> None:
    assert get_task("MountainCar-v0").observation_scale(0).real_env_steps == 10_000


def test_each_state_in_which_an_action_was_taken_counts_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also the first of an episode, not the last."""

    class Counting(gymnasium.Env[Any, Any]):
        observation_space = gymnasium.spaces.Box(0, 9, (1,), np.float32)
        action_space = gymnasium.spaces.Discrete(2)

        def __init__(self, **_: Any) -> None:
            self.age = 0

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            super().reset(seed=seed)
            self.age = 0
            return np.array([0], np.float32), {}

        def step(self, action: Any) -> Any:
            self.age += 1
            return np.array([self.age], np.float32), 0.0, self.age == 4, False, {}

    spec = gymnasium.envs.registration.EnvSpec(
        "test/Counting-v0", entry_point=Counting, reward_threshold=1.0, max_episode_steps=10
    )
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    scale = get_task(spec.id).observation_scale(0)
    assert scale.mean == pytest.approx(np.mean([0, 1, 2, 3]))
    assert scale.deviation == pytest.approx(np.std([0, 1, 2, 3]))


def test_a_compiled_task_is_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Episodes begin with an initial state, in which a pole stands nearly upright."""
    task = get_task("CartPole-v0")
    monkeypatch.setattr(Task, "make", None)
    monkeypatch.setattr(bilevel.tasks.task, "SCALE_STEPS", 2)
    means = [task.observation_scale(seed).mean[2] for seed in range(20)]
    assert np.abs(means).max() < 0.07
    assert np.abs(means).min() < 0.01


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_simulated_and_real_episodes_have_the_same_scale(
    task_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = get_task(task_id).observation_scale(0)
    observed = replace(get_task(task_id), dynamics=dynamics.OBSERVED)  # gymnasium runs it
    monkeypatch.setattr(bilevel.tasks.task, "GYMNASIUM_SCALE_STEPS", 30_000)
    real = observed.observation_scale(0)
    assert real.real_env_steps == 30_000
    np.testing.assert_allclose(simulated.deviation, real.deviation, rtol=0.3)
    error = (simulated.mean - real.mean) / real.deviation
    np.testing.assert_allclose(error, 0.0, atol=0.15)


def test_the_numbers_that_the_documents_give() -> None:
    """Of parameters and coordinates with the recipe `default`."""
    space, told = distribution("CartPole-v0").coordinates, (ROOT / "docs" / "nes.md").read_text()
    assert isinstance(space, ExogenousCoordinates)
    words = " ".join(told.split())
    assert f"({space.architecture.parameter_count} on CartPole" in words
    assert f"It moves {space.size} coordinates" in words
