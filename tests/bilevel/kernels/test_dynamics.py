"""The compiled dynamics against gymnasium, step by step."""

from typing import Any

import numpy as np
import pytest

from bilevel.kernels import dynamics
from bilevel.tasks import get_task

TRANSITIONS = 20_000


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_every_transition_equals_gymnasium(task_id: str, rng: np.random.Generator) -> None:
    task = get_task(task_id)
    env: Any = task.make().unwrapped
    physics = np.zeros(4)
    over = True
    episodes = 0
    for _ in range(TRANSITIONS):
        if over:
            state, _ = env.reset(seed=int(rng.integers(2**31)))
            physics[:] = env.state
            np.testing.assert_allclose(task.observe(physics), state, atol=1e-7)
            episodes += 1
        action = int(rng.integers(task.action_size))
        state, reward, terminated, _, _ = env.step(np.int64(action))
        got_reward, got_terminated = dynamics.step(task.dynamics, physics, action)
        assert (got_reward, got_terminated) == (reward, terminated)
        np.testing.assert_allclose(physics, env.state, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(task.observe(physics), state, atol=1e-6)
        physics[:] = env.state
        over = terminated or rng.random() < 0.002
    assert episodes > 10


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_initial_states_have_gymnasiums_distribution(task_id: str) -> None:
    from scipy.stats import ks_2samp

    task = get_task(task_id)
    ours = task.initial_physics(np.random.default_rng(1), 2000)
    env: Any = task.make().unwrapped
    theirs = []
    for seed in range(2000):
        env.reset(seed=seed)
        theirs.append(env.state)
    for k in range(4):
        assert ks_2samp(ours[:, k], np.array(theirs)[:, k]).pvalue > 0.001


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_observed_episodes_equal_single_steps(task_id: str) -> None:
    """Some episodes terminate, some end at the step limit."""
    task, rng = get_task(task_id), np.random.default_rng(0)
    actions = rng.integers(task.action_size, size=400)
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
