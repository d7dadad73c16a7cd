"""Recorded steps on a real task."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bilevel.tasks.task import Task

#: Maximum repetitions of a random action: actions that change at every step hardly move tasks with
#: momentum (Acrobot).
REPEATS = 4


@dataclass(frozen=True)
class Transitions:
    """N recorded steps of a real task."""

    states: NDArray[np.float32]  # (N, S)
    actions: NDArray[np.int64]  # (N,)
    next_states: NDArray[np.float32]  # (N, S)
    rewards: NDArray[np.float32]  # (N,)
    ends: NDArray[np.float32]  # (N,) 1 where the task terminated, 0 also at its step limit

    @classmethod
    def recorded(
        cls,
        task: Task,
        steps: int,
        seed: int,
        policy: Callable[[NDArray[np.float32]], int] | None = None,
        exploration: float = 0.0,
    ) -> Self:
        """Record `steps` steps of `policy`, from an initial state on; without a policy, of random
        actions, each repeated 1 to REPEATS times.

        With probability `exploration` such a random action replaces the policy's.
        """
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
                elif policy is None or rng.random() < exploration:
                    action, left = int(rng.integers(task.n_actions)), int(rng.integers(REPEATS))
                else:
                    action = policy(state)
                following, reward, terminated, truncated, _ = env.step(first + action)
                rows.append((state, action, following, float(reward), terminated))
                state = None if terminated or truncated else following
        states, actions, next_states, rewards, ends = zip(*rows, strict=True)
        return cls(
            np.array(states, np.float32),
            np.array(actions, np.int64),
            np.array(next_states, np.float32),
            np.array(rewards, np.float32),
            np.array(ends, np.float32),
        )

    def __add__(self, other: Self) -> Self:
        """Concatenate two datasets."""
        columns = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return type(self)(*map(np.concatenate, columns))

    @property
    def reward_survival(self) -> bool:
        """Whether rewards are positive on average, so that ending an episode is bad."""
        return bool(self.rewards.mean() > 0)

    def of_continuing_task(self) -> Self:
        """The continuing form of the task, in which each end leads to a new initial state (Sutton
        and Barto, 2018, section 3.3)."""
        # The step after an end begins an episode, and so does the first one.
        starts = np.roll(self.states, -1, axis=0)
        ended = self.ends[:, None] > 0
        next_states = np.where(ended, starts, self.next_states)
        return replace(self, next_states=next_states, ends=np.zeros_like(self.ends))
