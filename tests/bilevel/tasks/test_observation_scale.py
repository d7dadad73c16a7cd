"""The scale of observations under random actions."""

from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest

import bilevel.tasks.task
from bilevel.kernels import dynamics
from bilevel.tasks import get_task
from bilevel.tasks.task import MAX_SCALE_STEPS, SCALE_STEPS
from tests.envs import CustomEnv, register_env


def test_the_seed_determines_the_scale() -> None:
    task = get_task("CartPole-v0")
    one, two, other = (task.observation_scale(seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.deviation, two.deviation)
    assert not np.array_equal(one.deviation, other.deviation)
    assert SCALE_STEPS < one.real_env_steps <= MAX_SCALE_STEPS
    assert 0.3 < one.deviation[1] < 0.9  # velocity of the cart in units per second


def test_every_state_with_an_action_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Including the first state of an episode, without the last one."""

    ages = cycle(range(5))

    def step() -> Any:
        age = next(ages)
        return np.full(2, age), 0.0, age == 4, False, {}

    env = lambda **_: CustomEnv(lambda _: np.full(2, next(ages)), step)  # noqa: E731
    name = register_env(monkeypatch, env)
    steps: list[None] = []
    scale = get_task(name).observation_scale(0, lambda: steps.append(None))
    assert scale.real_env_steps == len(steps) == 2 * SCALE_STEPS  # both halves agree
    assert scale.mean[0] == pytest.approx(np.mean([0, 1, 2, 3]))
    assert scale.deviation[0] == pytest.approx(np.std([0, 1, 2, 3]))


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_simulated_and_real_episodes_have_the_same_scale(
    task_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bilevel.tasks.task, "SCALE_STEPS", 30_000)
    simulated = get_task(task_id).observation_scale(0)
    observed = replace(get_task(task_id), dynamics=dynamics.OBSERVED)  # gymnasium runs it
    real = observed.observation_scale(0)
    assert real.real_env_steps == 30_000
    np.testing.assert_allclose(simulated.deviation, real.deviation, rtol=0.3)
    error = (simulated.mean - real.mean) / real.deviation
    np.testing.assert_allclose(error, 0.0, atol=0.15)
