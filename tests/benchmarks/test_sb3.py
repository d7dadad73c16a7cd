from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest

from benchmarks.agents.sb3 import KINDS, score, trained
from bilevel.tasks import Task


class LeftAgent:
    """An agent that always pushes the cart to the left."""

    def predict(self, observation: Any, state: Any, **options: Any) -> tuple[Any, Any]:
        return np.zeros(len(observation), np.int64), state


def test_score_is_the_mean_return_on_the_real_task(cartpole: Task) -> None:
    """A cart that is pushed to one side falls after about nine steps."""
    assert 8.5 < score(LeftAgent(), cartpole.make(), 0) < 10.5


@pytest.mark.parametrize("kind", KINDS)
def test_an_agent_trains_for_the_given_steps(kind: str, cartpole: Task) -> None:
    agent = trained(kind, cartpole.make, 256, 0)
    assert type(agent).__name__ == kind
    assert agent.num_timesteps == 256


def test_tests_use_other_initial_states_than_training(cartpole: Task) -> None:
    class Recorder(gymnasium.Wrapper[Any, Any, Any, Any]):
        states: ClassVar[set[Any]] = set()

        def reset(self, **options: Any) -> Any:
            state, info = super().reset(**options)
            self.states.add(tuple(state))
            return state, info

    trained("DQN", lambda: Recorder(cartpole.make()), 64, 3)
    training = {*Recorder.states}
    # PPO trains in eight environments with consecutive seeds.
    training |= {tuple(cartpole.make().reset(seed=seed)[0]) for seed in range(20)}
    Recorder.states.clear()
    score(LeftAgent(), Recorder(cartpole.make()), 3)
    assert Recorder.states
    assert not training & Recorder.states
