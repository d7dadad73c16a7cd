from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest

from benchmarks.agents.sb3 import KINDS, score, trained
from bilevel.tasks import Task


class Left:
    """An agent that always pushes the cart to the left."""

    def predict(self, observation: Any, state: Any, **options: Any) -> tuple[Any, Any]:
        return np.zeros(len(observation), np.int64), state


def test_the_score_is_that_of_the_real_task(cartpole: Task) -> None:
    """Whoever pushes to one side falls after some nine steps."""
    assert 8.5 < score(Left(), cartpole.make(), 0) < 10.5


@pytest.mark.parametrize("kind", KINDS)
def test_an_agent_trains_for_so_many_steps(kind: str, cartpole: Task) -> None:
    agent = trained(kind, cartpole.make, 256, 0)
    assert type(agent).__name__ == kind
    assert agent.num_timesteps == 256


def test_no_agent_is_tested_from_states_that_it_was_trained_from(cartpole: Task) -> None:
    class Watched(gymnasium.Wrapper[Any, Any, Any, Any]):
        seen: ClassVar[list[Any]] = []

        def reset(self, **options: Any) -> Any:
            state, info = super().reset(**options)
            self.seen.append(tuple(state))
            return state, info

    trained("DQN", lambda: Watched(cartpole.make()), 64, 3)
    before = {*Watched.seen}
    Watched.seen.clear()
    score(Left(), Watched(cartpole.make()), 3)
    assert len(before) > 1
    assert not before & {*Watched.seen}
    # Nor from those of other seeds; PPO trains in eight environments, from its seed on.
    for seed in range(20):
        first, _ = cartpole.make().reset(seed=seed)
        assert tuple(first) not in Watched.seen
