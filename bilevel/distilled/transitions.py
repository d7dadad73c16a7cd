"""Recorded steps on a real task."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bilevel.tasks import Task

#: How often a random action is repeated at most: of actions that change every step, tasks
#: with momentum (Acrobot) see little.
REPEATS = 4


@dataclass(frozen=True)
class Transitions:
    """N recorded steps."""

    states: NDArray[np.float32]  # (N, S)
    actions: NDArray[np.int64]  # (N,)
    next_states: NDArray[np.float32]  # (N, S)
    rewards: NDArray[np.float32]  # (N,)
    ends: NDArray[np.float32]  # (N,) 1 where the task ended, not at its step limit

    @classmethod
    def recorded(
        cls,
        task: Task,
        steps: int,
        seed: int,
        policy: Callable[[NDArray[np.float32]], int] | None = None,
        exploration: float = 0.0,
    ) -> Self:
        """So many steps of a policy, the first of them a start of the task; without a policy,
        of random actions, each repeated 1 to REPEATS times.

        The policy gives way to such a random action with probability `exploration`.
        """
        rng = np.random.default_rng(seed)
        env = task.make()
        first = env.action_space.start  # type: ignore[attr-defined]
        rows: list[tuple[Any, ...]] = []
        state, left, action = None, 0, 0
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
        env.close()
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
        """Whether an end, after which there are no rewards, is worse than none."""
        return bool(self.rewards.mean() > 0)

    def of_continuing_task(self) -> Self:
        """As if the task, where it ended, had gone on from a new start: the continuing form of
        an episodic task (Sutton and Barto, 2018, section 3.3)."""
        starts = np.roll(self.states, -1, axis=0)  # behind an end; all recordings begin with one
        ended = self.ends[:, None] > 0
        next_states = np.where(ended, starts, self.next_states)
        return replace(self, next_states=next_states, ends=np.zeros_like(self.ends))
