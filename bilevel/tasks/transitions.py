"""Recorded steps of a real task."""

from contextlib import closing
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bilevel.tasks.task import Task

#: Maximum repetitions of a random action. Actions that change in every step hardly move tasks with
#: momentum (Acrobot).
REPEATS = 4


@dataclass(frozen=True)
class Transitions:
    """N recorded steps of a real task."""

    states: NDArray[np.float32]  # (N, S)
    actions: NDArray[np.int64]  # (N,)
    next_states: NDArray[np.float32]  # (N, S)
    rewards: NDArray[np.float32]  # (N,)
    ends: NDArray[np.float32]  # (N,) 1 where the task terminated; 0 if it was truncated

    @classmethod
    def recorded(cls, task: Task, steps: int, seed: int) -> Self:
        """Record `steps` steps of random actions, each repeated 1 to REPEATS times."""
        rng = np.random.default_rng(seed)
        rows: list[tuple[Any, ...]] = []
        state, left, action = None, 0, 0
        with closing(task.make()) as env:
            first = env.action_space.start  # type: ignore[attr-defined]
            while len(rows) < steps:
                if state is None:
                    state, left = env.reset(seed=int(rng.integers(2**31)))[0], 0
                if left:
                    left -= 1
                else:
                    action, left = int(rng.integers(task.n_actions)), int(rng.integers(REPEATS))
                next_state, reward, terminated, truncated, _ = env.step(first + action)
                rows.append((state, action, next_state, reward, terminated))
                state = None if terminated or truncated else next_state
        types = (np.float32, np.int64, np.float32, np.float32, np.float32)
        columns = zip(*rows, strict=True)
        return cls(*(np.array(c, kind) for c, kind in zip(columns, types, strict=True)))
