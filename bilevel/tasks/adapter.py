"""Gymnasium environments of real tasks, with flat states and validated values."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.spaces import Action, Actions, Observations, State
from bilevel.tasks.source import GymEnv
from bilevel.user_code import UserCodeError, user_code_errors

#: Largest number in float32.
LARGEST = float(np.finfo(np.float32).max)


class RealEnv:
    """A real task with states (S,) and actions as agents use them (`bilevel.spaces`). Errors and
    invalid values of the user's environment raise UserCodeError. Raises InvalidInput for
    unsupported spaces."""

    def __init__(self, env: GymEnv, task_id: str) -> None:
        self.env = env
        self._name = f"task {task_id!r}"
        self._stepping = user_code_errors(self._name, "takes a step")
        self.observations = Observations(env.observation_space, task_id)
        self.actions = Actions(env.action_space, task_id)

    def reset(self, seed: int | None = None) -> State:
        """Start an episode; return the initial state (S,)."""
        return self.raw_reset(seed).astype(np.float32)

    def raw_reset(self, seed: int | None = None) -> NDArray[Any]:
        """Start an episode; return the initial state (S,) in the dtype of the space."""
        with user_code_errors(self._name, "is reset"):
            return self._checked(self.env.reset(seed=seed)[0], 0.0).copy()

    def step(self, action: Action) -> tuple[State, float, bool, bool]:
        """Take one step: next state (S,), reward, terminated, truncated. Raises InvalidInput for
        invalid actions."""
        taken = self.actions.outward(action)
        with self._stepping:
            observation, reward, terminated, truncated, _ = self.env.step(taken)
            number = float(reward)
            # A copy: an environment may write its next observation into the array.
            state = self._checked(observation, number).astype(np.float32)
            return state, number, bool(terminated), bool(truncated)

    def random_step(self) -> tuple[NDArray[Any], bool]:
        """Take a random action: next state (S,) in the dtype of the space, end of the episode."""
        with self._stepping:
            action = self.env.action_space.sample()
            observation, reward, terminated, truncated, _ = self.env.step(action)
            state = self._checked(observation, float(reward)).copy()
            return state, bool(terminated or truncated)

    def close(self) -> None:
        """Close the simulator, which may hold processes or sockets."""
        self.env.close()

    def _checked(self, observation: Any, reward: float) -> NDArray[Any]:
        state, expected = self.observations.flatten(observation), (self.observations.size,)
        if state.shape != expected:
            raise UserCodeError(f"{self._name} observes the shape {state.shape}, not {expected}")
        if not (np.abs(state).max() <= LARGEST and math.isfinite(reward)):
            raise UserCodeError(
                f"{self._name} returns {observation} and the reward {reward}: not finite in float32"
            )
        return state
