"""The compiled dynamics against gymnasium, step by step."""

from typing import Any

import numpy as np
import pytest

from bilevel.kernels import dynamics
from bilevel.tasks import BUILT_IN_TASKS, get_task

TRANSITIONS = 5_000


@pytest.mark.parametrize("task_id", BUILT_IN_TASKS)
def test_every_transition_equals_gymnasium(task_id: str, rng: np.random.Generator) -> None:
    task = get_task(task_id)
    env: Any = task.make().unwrapped
    actions = task.real_env().actions
    # Gymnasium computes forces of continuous actions in float32.
    rtol, atol = (1e-6, 1e-6) if task.continuous else (1e-9, 1e-12)
    physics = np.zeros(task.initial_physics(rng, 1).shape[1])
    over = True
    episodes = 0
    for _ in range(TRANSITIONS):
        if over:
            state, _ = env.reset(seed=int(rng.integers(2**31)))
            physics[:] = env.state
            np.testing.assert_allclose(task.observe(physics), state, atol=1e-7)
            episodes += 1
        action: Any
        if task.continuous:
            action = rng.uniform(-1, 1, 1).astype(np.float32)
        else:
            action = int(rng.integers(task.action_size))
        state, reward, terminated, _, _ = env.step(actions.outward(action))
        number = float(np.ravel(action)[0])
        got_reward, got_terminated = dynamics.step(task.dynamics, physics, number)
        expected = pytest.approx(float(reward), rel=rtol, abs=atol)
        assert (got_reward, got_terminated) == (expected, terminated)
        np.testing.assert_allclose(physics, env.state, rtol=rtol, atol=atol)
        np.testing.assert_allclose(task.observe(physics), state, atol=1e-6)
        physics[:] = env.state
        over = terminated or rng.random() < 0.005
    assert episodes > 10


@pytest.mark.parametrize("task_id", BUILT_IN_TASKS)
def test_whole_episodes_equal_gymnasium(task_id: str, rng: np.random.Generator) -> None:
    """Rounding errors grow in chaotic tasks, so actions repeat and episodes are short."""
    task = get_task(task_id)
    env, raw = task.real_env(), task.make().unwrapped
    for seed in range(5):
        env.reset(seed)
        raw.reset(seed=seed)
        physics = np.array(raw.state, np.float64)  # type: ignore[attr-defined]
        size = task.action_size
        action: Any = np.array([0.7 - seed / 3], np.float32) if task.continuous else seed % size
        for _ in range(50):
            state, reward, terminated, _ = env.step(action)
            got = dynamics.step(task.dynamics, physics, float(np.ravel(action)[0]))
            assert got == (pytest.approx(reward, rel=1e-3), terminated)
            np.testing.assert_allclose(task.observe(physics), state, rtol=1e-3, atol=1e-4)
            if terminated:
                break


@pytest.mark.parametrize("task_id", BUILT_IN_TASKS)
def test_initial_states_have_gymnasiums_distribution(task_id: str) -> None:
    from scipy.stats import ks_2samp

    task = get_task(task_id)
    ours = task.initial_physics(np.random.default_rng(1), 2000)
    env: Any = task.make().unwrapped
    theirs = []
    for seed in range(2000):
        env.reset(seed=seed)
        theirs.append(np.array(env.state))
    for k in range(ours.shape[1]):
        assert ks_2samp(ours[:, k], np.array(theirs)[:, k]).pvalue > 0.001


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_observed_episodes_equal_single_steps(task_id: str) -> None:
    """Some episodes terminate, some end at the step limit."""
    task, rng = get_task(task_id), np.random.default_rng(0)
    actions = rng.integers(task.action_size, size=400).astype(float)
    initial = task.initial_physics(rng, actions.size)
    step_limit, ends = 15, {True: 0, False: 0}
    seen = np.empty((actions.size, task.state_size), np.float32)
    dynamics.observe_episodes(task.dynamics, step_limit, actions, initial.copy(), seen)
    episode, age, state = 0, 0, np.empty(task.state_size, np.float32)
    for k, action in enumerate(actions):
        dynamics.observe(task.dynamics, initial[episode], state)
        np.testing.assert_allclose(seen[k], state, rtol=1e-4, atol=1e-6)
        _, terminated = dynamics.step(task.dynamics, initial[episode], action)
        age += 1
        if terminated or age == step_limit:
            ends[terminated] += 1
            episode, age = episode + 1, 0
    assert ends[False] > 5
    assert (ends[True] > 5) == (task_id == "CartPole-v0")
