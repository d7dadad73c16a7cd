"""Gymnasium environments of real tasks, with validation of actions and returned values."""

import operator
import warnings
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.user_code import UserCodeError, user_code_errors

#: A real task in gymnasium.
RealEnv = gymnasium.Env[NDArray[np.float32], np.int64]


def make_env(
    task_id: str, step_limit: int | None = None, render_mode: str | None = None
) -> RealEnv:
    """Create a task's environment. Raises gymnasium's and the environment's errors."""
    # A task without rendering need not accept the argument.
    kwargs: dict[str, Any] = {} if render_mode is None else {"render_mode": render_mode}
    with warnings.catch_warnings():
        # The paper's CartPole-v0 is not the latest version.
        warnings.filterwarnings("ignore", ".*(out of date|latest versioned)")
        # The environment checker repeats its warnings for every environment.
        return gymnasium.make(task_id, step_limit, disable_env_checker=True, **kwargs)


def checked_action(action: Any, n_actions: int, first: int = 0) -> int:
    """Return the index, from 0, of an action of a Discrete space that starts at `first`.

    The action may be an integer of any type, such as a torch tensor. Raises InvalidInput for other
    values.
    """
    try:
        index = operator.index(action) - first
    except TypeError:
        index = -1
    if not 0 <= index < n_actions:
        last = first + n_actions - 1
        raise InvalidInput(f"action {action!r} is not allowed: allowed are {first} to {last}")
    return index


class CheckedEnv(gymnasium.Wrapper[NDArray[np.float32], np.int64, NDArray[np.float32], np.int64]):
    """A user's environment, whose errors and invalid return values raise UserCodeError."""

    def __init__(self, env: RealEnv, task_id: str) -> None:
        super().__init__(env)
        self._name = f"task {task_id!r}"

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """See gymnasium."""
        with user_code_errors(self._name, "is reset"):
            state, info = self.env.reset(seed=seed, options=options)
            return self._checked(state, 0.0), info

    def step(
        self, action: np.int64
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """See gymnasium."""
        with user_code_errors(self._name, "takes a step"):
            state, reward, terminated, truncated, info = self.env.step(action)
            number = float(reward)
            return self._checked(state, number), number, bool(terminated), bool(truncated), info

    def _checked(self, state: Any, reward: float) -> NDArray[np.float32]:
        # A copy: a task may write its next observation into the same array.
        array, shape = np.array(state), self.observation_space.shape
        if array.shape != shape:
            raise UserCodeError(f"{self._name} observes the shape {array.shape} instead of {shape}")
        if not np.isfinite(array).all() or not np.isfinite(reward):
            raise UserCodeError(f"{self._name} returns {array} and the reward {reward}: not finite")
        return array
