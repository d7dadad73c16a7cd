"""SEs fitted to the real task."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import load_preset
from bilevel.kernels.blas import one_blas_thread
from bilevel.kernels.ddqn import greedy_action, new_agent
from bilevel.kernels.synthetic_env import step
from bilevel.synthetic_env import Architecture, fitted, kernel_form
from bilevel.synthetic_env.fitted import LEAST_DONE, Lessons, action_values, fitted_psi
from bilevel.synthetic_env.fitted.action_values import ActionValues
from bilevel.synthetic_env.fitted.transitions import REPEATS, Transitions
from bilevel.tasks import Task, get_task
from search_spaces import draw_agent
from tests.conftest import ddqn


@pytest.fixture(scope="module")
def architecture() -> Architecture:
    return Architecture(4, 2, 1, 32, "lrelu")


@pytest.fixture(scope="module")
def psi(architecture: Architecture) -> np.ndarray:
    """Of a seed whose Q-learning solves the task."""
    return fitted_psi(get_task("CartPole-v0"), architecture, 4)


@pytest.fixture(scope="module")
def acrobot_psi() -> np.ndarray:
    """Likewise."""
    task = get_task("Acrobot-v1")
    return fitted_psi(task, Architecture.of(task, load_preset("tuned", task.id).se), 4)


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_transitions_are_the_tasks(task_id: str) -> None:
    task = get_task(task_id)
    data = Transitions.recorded(task, 1000, 5)
    assert data.states.shape == data.next_states.shape == (1000, task.state_size)
    assert set(data.actions) == set(range(task.n_actions))
    goes_on = np.all(data.next_states[:-1] == data.states[1:], axis=1)
    assert goes_on[data.ends[:-1] == 0].mean() > 0.99  # but for the step limit
    assert not goes_on[data.ends[:-1] == 1].any()
    changes = np.flatnonzero(np.diff(data.actions))
    assert 1.5 < 1000 / changes.size < 2 * REPEATS  # as actions may follow themselves
    again = Transitions.recorded(task, 1000, 5)
    np.testing.assert_array_equal(data.states, again.states)
    assert not np.array_equal(data.states, Transitions.recorded(task, 1000, 6).states)


def test_a_step_limit_is_no_end() -> None:
    data = Transitions.recorded(get_task("CartPole-v0", step_limit=5), 100, 0)
    assert not data.ends.any()
    follows = np.all(data.next_states[:-1] == data.states[1:], axis=1)
    np.testing.assert_array_equal(np.flatnonzero(~follows), np.arange(4, 99, 5))


def test_a_policy_acts_but_for_its_exploration(cartpole: Task) -> None:
    data = Transitions.recorded(cartpole, 2000, 1, lambda state: int(state[2] > 0), 0.0)
    np.testing.assert_array_equal(data.actions, data.states[:, 2] > 0)
    mixed = Transitions.recorded(cartpole, 2000, 1, lambda state: int(state[2] > 0), 0.3)
    # A random action is 2.5 steps long on average, and every second one is the policy's.
    random = 0.3 * 2.5 / (0.7 + 0.3 * 2.5)
    differs = (mixed.actions != (mixed.states[:, 2] > 0)).mean()
    assert abs(differs - random / 2) < 0.05
    both = data + mixed
    assert len(both.actions) == 4000
    np.testing.assert_array_equal(both.rewards[2000:], mixed.rewards)


def test_ends_that_nobody_wants_are_left_out(cartpole: Task) -> None:
    """A new start follows on them; what is no end stays."""
    data = Transitions.recorded(cartpole, 200, 1) + Transitions.recorded(cartpole, 200, 2)
    assert data.reward_survival
    endless, ended = data.of_continuing_task(), data.ends > 0
    assert 5 < ended.sum() < 50
    assert not endless.ends.any()
    np.testing.assert_array_equal(endless.next_states[~ended], data.next_states[~ended])
    assert (np.abs(data.next_states[ended]).max(axis=1) > 0.2).all()
    assert (np.abs(endless.next_states[ended]) <= 0.05).all()  # CartPole's starts
    assert not Transitions.recorded(get_task("Acrobot-v1"), 200, 1).reward_survival


def test_the_best_snapshot_is_kept(cartpole: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second of three, its scores being given; or the first that solves the task."""
    monkeypatch.setattr(action_values, "SNAPSHOT_STEPS", 5)
    data = Transitions.recorded(cartpole, 300, 1)

    def learned(*scores: float) -> np.ndarray:
        left = iter(scores)
        monkeypatch.setattr(action_values, "SNAPSHOTS", len(scores))
        monkeypatch.setattr(action_values, "real_returns", lambda *_: np.array([next(left)]))
        values = ActionValues.learned(cartpole, data, 1)
        assert values.score == max(s for s in scores[:2])
        return values.agent.theta

    second = learned(10.0, 90.0)
    np.testing.assert_array_equal(learned(10.0, 90.0, 20.0), second)
    np.testing.assert_array_equal(learned(10.0, 196.0, 200.0), second)
    assert not np.array_equal(learned(90.0, 10.0), second)


def test_action_values_solve_the_task(cartpole: Task) -> None:
    """Of states that are not brought to unit scale."""
    data = Transitions.recorded(cartpole, 10_000, 4)
    with one_blas_thread():
        values = ActionValues.learned(cartpole, data, 4)
    assert values.score >= cartpole.solved_reward
    assert cartpole.test_returns(values.greedy, 10, 77).mean() > 150
    advantages = values.advantages(data.states)
    assert advantages.shape == (10_000, 2)
    assert advantages.std() == pytest.approx(1, abs=1e-3)
    np.testing.assert_allclose(advantages.sum(axis=1), 0, atol=1e-5)
    greedy = [values.greedy(state) for state in data.states[:200]]
    np.testing.assert_array_equal(advantages[:200].argmax(axis=1), greedy)


def test_the_network_takes_raw_states(rng: np.random.Generator) -> None:
    """Far from the origin, in units of their own."""
    hp = replace(ddqn(load_preset("default", "CartPole-v0")), hidden_size=8, hidden_layers=2)
    agent = new_agent(hp, 4, 2, rng)
    mean, scale = rng.normal(0, 5, 4).astype(np.float32), np.array([0.1, 1, 3, 9], np.float32)
    states = (mean + scale * rng.normal(size=(50, 4))).astype(np.float32)
    raw = agent._replace(theta=action_values.of_raw_states(agent, mean, scale))
    for state in states:
        greedy_action(agent, (state - mean) / scale)
        expected = agent.single_y.copy()
        greedy_action(raw, state)
        np.testing.assert_allclose(raw.single_y, expected, atol=1e-4)


def test_the_policy_is_recorded_too(
    cartpole: Task, architecture: Architecture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what random steps have taught."""
    monkeypatch.setattr(action_values, "SNAPSHOTS", 1)
    monkeypatch.setattr(fitted, "FIT_STEPS", 1)
    monkeypatch.setattr(fitted, "RANDOM_STEPS", 100)
    monkeypatch.setattr(fitted, "POLICY_STEPS", 200)
    monkeypatch.setattr(fitted, "lessons", fitted.lessons.__wrapped__)  # forgotten afterwards
    recorded, fitted_to = [], []

    def record(*arguments: Any) -> Transitions:
        recorded.append(arguments)
        return Transitions.recorded(*arguments)

    def regressed(_: Architecture, taught: Lessons) -> np.ndarray:
        fitted_to.append(taught.data)
        return np.zeros(1, np.float32)

    monkeypatch.setattr(fitted, "Transitions", SimpleNamespace(recorded=record))
    monkeypatch.setattr(fitted, "_regressed", regressed)
    fitted_psi(cartpole, architecture, 0)
    (_, steps, first, *nothing), (_, more, second, policy, exploration) = recorded
    assert (steps, more, nothing, exploration) == (100, 200, [], fitted.EXPLORATION)
    assert first != second
    assert policy(np.zeros(4, np.float32)) in (0, 1)
    assert len(fitted_to[0].actions) == 300


def test_what_fits_have_in_common_is_learned_once(
    cartpole: Task, architecture: Architecture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And does not depend on who asked before."""
    taught = fitted.lessons(cartpole, 4)
    small = fitted_psi(cartpole, replace(architecture, hidden_size=8), 4)
    with monkeypatch.context() as patch:
        patch.setattr(fitted, "Transitions", None)
        wide = fitted_psi(cartpole, replace(architecture, hidden_size=16), 4)
        np.testing.assert_array_equal(
            fitted_psi(cartpole, replace(architecture, hidden_size=8), 4), small
        )
    assert wide.size > small.size
    fitted.lessons.cache_clear()
    again = fitted.lessons(cartpole, 4)
    np.testing.assert_array_equal(again.rewards, taught.rewards)
    np.testing.assert_array_equal(again.data.next_states, taught.data.next_states)
    assert not np.array_equal(fitted.lessons(cartpole, 5).rewards, taught.rewards)


def test_a_rare_end_is_not_missed(architecture: Architecture) -> None:
    """One step in twenty ends the episode, and nothing tells which."""
    states = np.full((400, 4), 0.1, np.float32)
    actions, rewards = np.zeros(400, np.int64), np.ones(400, np.float32)
    ends = (np.arange(400) % 20 == 0).astype(np.float32)
    data = Transitions(states, actions, states, rewards, ends)
    psi = fitted._regressed(architecture, Lessons(data, rewards, 0))
    se, work = kernel_form(architecture, psi), np.zeros((2, 96), np.float32)
    _, done = step(se, states[0], 0, np.zeros(4, np.float32), work)
    assert done == pytest.approx((1 + LEAST_DONE) / 2, abs=0.05)


def test_the_teachers_that_solve_the_task_are_asked(
    cartpole: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The best one where none does."""
    data = Transitions.recorded(cartpole, 300, 1)
    monkeypatch.setattr(action_values, "SNAPSHOTS", 1)
    monkeypatch.setattr(action_values, "SNAPSHOT_STEPS", 5)

    def rewards(*scores: float) -> np.ndarray:
        left = iter(scores)
        monkeypatch.setattr(action_values, "real_returns", lambda *_: np.array([next(left)]))
        return fitted.advantages(cartpole, data, list(range(len(scores))))

    alone = rewards(20.0)
    np.testing.assert_array_equal(rewards(20.0, 10.0, 19.0), alone)
    assert not np.array_equal(rewards(200.0, 10.0, 196.0), alone)
    np.testing.assert_array_equal(rewards(200.0, 10.0, 20.0), rewards(200.0))


def predictions(
    data: Transitions, architecture: Architecture, psi: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Next states (N, S), rewards (N,) and raw dones (N,) of recorded states and actions."""
    se, work = kernel_form(architecture, psi), np.zeros((2, 400), np.float32)
    following = np.zeros_like(data.next_states)
    steps = zip(data.states, data.actions, following, strict=True)
    rewards, dones = np.array([step(se, *one, work) for one in steps]).T
    return following, rewards, dones


def test_an_se_predicts_the_task_and_starts_over(
    cartpole: Task, architecture: Architecture, psi: np.ndarray
) -> None:
    """On transitions that it was not fitted to."""
    data = Transitions.recorded(cartpole, 500, 99)
    predicted, rewards, dones = predictions(data, architecture, psi)
    on = data.ends == 0
    error = np.median(np.abs(predicted - data.next_states)[on], axis=0)
    assert (error < 0.1 * data.next_states.std(axis=0)).all()
    assert -1 < rewards.min() < 0 < 1 < rewards.max() < 2
    assert np.abs(dones - LEAST_DONE).max() < 0.04
    tilted, over = np.abs(data.next_states[~on, 2]), np.abs(predicted[~on, 2])
    assert (over < 0.5 * tilted).mean() > 0.9


def test_an_se_ends_where_the_end_is_the_aim(acrobot_psi: np.ndarray) -> None:
    """Which few random actions reach."""
    task = get_task("Acrobot-v1")
    architecture = Architecture.of(task, load_preset("tuned", task.id).se)
    data = Transitions.recorded(task, 20_000, 99)
    assert data.ends.sum() > 3
    _, _, dones = predictions(data, architecture, acrobot_psi)
    assert abs(np.median(dones[data.ends == 0]) - LEAST_DONE) < 0.03
    assert (dones[data.ends == 0] > 0.5).mean() < 0.05
    assert (dones[data.ends == 1] > 0.5).mean() > 0.7


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
    assert np.mean(scores) > 180


def test_it_is_determined_by_its_seed(cartpole: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    small = Architecture(4, 2, 2, 8, "prelu")
    monkeypatch.setattr(fitted, "RANDOM_STEPS", 150)
    monkeypatch.setattr(fitted, "POLICY_STEPS", 150)
    monkeypatch.setattr(action_values, "SNAPSHOTS", 2)
    monkeypatch.setattr(action_values, "SNAPSHOT_STEPS", 20)
    monkeypatch.setattr(fitted, "FIT_STEPS", 50)
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
    monkeypatch.setattr(fitted, "RANDOM_STEPS", 50)
    monkeypatch.setattr(fitted, "POLICY_STEPS", 50)
    monkeypatch.setattr(action_values, "SNAPSHOTS", 1)
    task = get_task("MountainCar-v0")
    data = Transitions.recorded(task, 100, 0)
    assert not data.ends.any()
    assert np.isfinite(fitted_psi(task, Architecture(2, 3, 1, 8, "relu"), 0)).all()
