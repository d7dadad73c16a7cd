"""Environments of the Python training loop (`TrainingEnvironment` in `training`)."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels.environment import Environment, reset, step
from bilevel.tasks import Task


@dataclass
class KernelEnvironment:
    """An SE or a compiled real task, stepped by the compiled code. It returns copies of its state,
    so that agents cannot change it."""

    env: Environment
    state: NDArray[np.float32] = field(init=False)

    @property
    def step_limit(self) -> int:
        """Maximum number of steps per episode."""
        return self.env.step_limit

    def reset(self, episode: int) -> NDArray[np.float32]:
        """The initial state (S,) of an episode."""
        self.state = np.zeros(self.env.state_size, np.float32)
        reset(self.env, episode, self.state)
        return self.state.copy()

    def step(self, action: int) -> tuple[NDArray[np.float32], float, float, bool]:
        """Take one step: next state (S,), reward, raw done, and True at the end of an episode."""
        next_state = np.empty_like(self.state)
        reward, done, over = step(self.env, self.state, action, next_state)
        self.state = next_state
        return next_state.copy(), float(reward), float(done), bool(over)


class GymnasiumEnvironment:
    """A real task that gymnasium runs; it may hold processes or sockets until it is closed.

    Each episode has its own seed, so that all agents start it in the same state, even if the task
    draws random numbers in its steps.
    """

    def __init__(self, task: Task, seed: int) -> None:
        self._env: Any = task.make()
        self._seed = seed
        self.step_limit = task.step_limit

    def close(self) -> None:
        """Close the simulator."""
        self._env.close()

    def reset(self, episode: int) -> NDArray[np.float32]:
        """The initial state (S,) of an episode."""
        (word,) = np.random.SeedSequence([self._seed, episode]).generate_state(1)
        state, _ = self._env.reset(seed=int(word) % 2**31)
        return np.asarray(state, np.float32)

    def step(self, action: int) -> tuple[NDArray[np.float32], float, float, bool]:
        """Take one step: next state (S,), reward, 1 if the task terminated the episode, and True if
        it was terminated or truncated."""
        state, reward, terminated, truncated, _ = self._env.step(
            self._env.action_space.start + action
        )
        over = bool(terminated or truncated)
        return np.asarray(state, np.float32), float(reward), float(terminated), over
