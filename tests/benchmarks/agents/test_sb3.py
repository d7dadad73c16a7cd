from typing import Any

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
