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
        action = int(rng.integers(task.n_actions))
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


def test_observed_dynamics_end_a_run_at_once() -> None:
    reward, terminated = dynamics.step(dynamics.OBSERVED, np.zeros(3), 0)
    assert np.isnan(reward)
    assert terminated
