"""SEs fitted to the real task."""

from dataclasses import replace

import numpy as np
import pytest

from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import load_preset
from bilevel.kernels.synthetic_env import step
from bilevel.synthetic_env import Architecture, fitted, kernel_form
from bilevel.synthetic_env.fitted import LEAST_DONE, REPEATS, Transitions, fitted_psi
from bilevel.tasks import Task, get_task
from search_spaces import draw_agent


@pytest.fixture(scope="module")
def architecture() -> Architecture:
    return Architecture(4, 2, 1, 32, "lrelu")


@pytest.fixture(scope="module")
def psi(architecture: Architecture) -> np.ndarray:
    """Of a seed whose Q-learning solves the task."""
    return fitted_psi(get_task("CartPole-v0"), architecture, 3)


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_transitions_are_the_tasks(task_id: str) -> None:
    task = get_task(task_id)
    data = Transitions.random(task, 1000, 5)
    assert data.states.shape == data.next_states.shape == (1000, task.state_size)
    assert set(data.actions) == set(range(task.n_actions))
    goes_on = np.all(data.next_states[:-1] == data.states[1:], axis=1)
    assert goes_on[data.ends[:-1] == 0].mean() > 0.99  # but for the step limit
    assert not goes_on[data.ends[:-1] == 1].any()
    changes = np.flatnonzero(np.diff(data.actions))
    assert 1.5 < 1000 / changes.size < 2 * REPEATS  # as actions may follow themselves
    again = Transitions.random(task, 1000, 5)
    np.testing.assert_array_equal(data.states, again.states)
    assert not np.array_equal(data.states, Transitions.random(task, 1000, 6).states)


def test_a_step_limit_is_no_end() -> None:
    data = Transitions.random(get_task("CartPole-v0", step_limit=5), 100, 0)
    assert not data.ends.any()
    follows = np.all(data.next_states[:-1] == data.states[1:], axis=1)
    np.testing.assert_array_equal(np.flatnonzero(~follows), np.arange(4, 99, 5))


def test_the_best_snapshot_is_kept(
    cartpole: Task, architecture: Architecture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second of three, its scores being given; or the first that solves the task."""
    monkeypatch.setattr(fitted, "STEPS", 300)
    monkeypatch.setattr(fitted, "_SNAPSHOT_STEPS", 5)
    monkeypatch.setattr(fitted, "_FIT_STEPS", 5)

    def fit(*scores: float) -> np.ndarray:
        left = iter(scores)
        monkeypatch.setattr(fitted, "_SNAPSHOTS", len(scores))
        monkeypatch.setattr(Task, "test_returns", lambda *_: np.array([next(left)]))
        return fitted_psi(cartpole, architecture, 1)

    second = fit(10.0, 90.0)
    np.testing.assert_array_equal(fit(10.0, 90.0, 20.0), second)
    np.testing.assert_array_equal(fit(10.0, 196.0, 200.0), second)
    assert not np.array_equal(fit(90.0, 10.0), second)


def test_an_se_predicts_the_task(
    cartpole: Task, architecture: Architecture, psi: np.ndarray
) -> None:
    """On transitions that it was not fitted to."""
    data = Transitions.random(cartpole, 500, 99)
    se, work = kernel_form(architecture, psi), np.zeros((2, 96), np.float32)
    predicted = np.zeros_like(data.next_states)
    rewards, dones = np.array(
        [
            step(se, state, action, following, work)
            for state, action, following in zip(data.states, data.actions, predicted, strict=True)
        ]
    ).T
    error = np.std(predicted - data.next_states, axis=0) / np.std(data.next_states, axis=0)
    assert (error < 0.05).all()
    assert -0.5 < rewards.min() < 0.5 < 1.5 < rewards.max() < 2.5
    going_on = dones[data.ends == 0]
    assert abs(np.median(going_on) - LEAST_DONE) < 0.03
    assert (going_on > 0.5).mean() < 0.2
    assert (dones[data.ends == 1] > 0.5).mean() > 0.9


def test_agents_learn_the_task_on_it(
    cartpole: Task, architecture: Architecture, psi: np.ndarray
) -> None:
    """Varied ones, which on a random SE score about 10."""
    agents = load_preset("default", "CartPole-v0").agents
    scores = [
        np.mean(
            train_and_test(
                cartpole, (architecture, psi), draw_agent(agents, "small", seed), seed
            ).test_returns
        )
        for seed in range(4)
    ]
    assert np.mean(scores) > 150


def test_it_is_determined_by_its_seed(cartpole: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    small = Architecture(4, 2, 2, 8, "prelu")
    monkeypatch.setattr(fitted, "STEPS", 300)
    monkeypatch.setattr(fitted, "_SNAPSHOTS", 2)
    monkeypatch.setattr(fitted, "_SNAPSHOT_STEPS", 20)
    monkeypatch.setattr(fitted, "_FIT_STEPS", 50)
    first, again, other = (fitted_psi(cartpole, small, seed) for seed in (1, 1, 2))
    assert first.shape == (small.parameter_count,)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    scaled = fitted_psi(cartpole, replace(small, reward_scale=0.1), 1)
    next_state, reward, done = small.split(scaled == first)
    assert next_state.all()
    assert not reward.all()
    assert done.all()


def test_a_task_without_ends_and_without_rewards(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing to learn from: any SE will do, if its numbers are finite."""
    monkeypatch.setattr(fitted, "STEPS", 100)
    monkeypatch.setattr(fitted, "_SNAPSHOTS", 1)
    task = get_task("MountainCar-v0")
    data = Transitions.random(task, 100, 0)
    assert not data.ends.any()
    assert np.isfinite(fitted_psi(task, Architecture(2, 3, 1, 8, "relu"), 0)).all()
