"""Environments of the Python training loop."""

from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from bilevel.agents.environments import GymnasiumEnvironment
from bilevel.tasks import Task, get_task


class Gusty(gymnasium.Env[Any, Any]):
    """Draws a random number in every step; action 1 ends the episode earlier."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.steps = 0
        return self.np_random.standard_normal(1).astype(np.float32), {}

    def step(self, action: Any) -> Any:
        self.steps += 1
        state = self.np_random.standard_normal(1).astype(np.float32)
        return state, 1.0, self.steps == (5, 2)[action], False, {}


@pytest.fixture
def gusty(monkeypatch: pytest.MonkeyPatch) -> Task:
    spec = EnvSpec("test/Gusty-v0", lambda **_: Gusty(), reward_threshold=9.0, max_episode_steps=9)
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    return get_task(spec.id)


def initial_states(task: Task, action: int, seed: int) -> list[float]:
    states = []
    with closing(GymnasiumEnvironment(task, seed)) as env:
        for episode in range(4):
            states.append(float(env.reset(episode)[0]))
            while not env.step(action)[3]:
                pass
    return states


def test_initial_states_do_not_depend_on_earlier_actions(gusty: Task) -> None:
    seed = 2**63 + 5  # like seeds of evaluations
    ours = initial_states(gusty, 0, seed)
    assert ours == initial_states(gusty, 1, seed)
    assert len(set(ours)) == 4
    assert ours != initial_states(gusty, 0, seed + 1)
