"""Checks of agents that users write: return values, exceptions and exits."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.agent import Agent, Transition
from bilevel.errors import InvalidInput
from bilevel.tasks import checked_action
from bilevel.user_code import UserCodeError, user_code_errors


class CheckedAgent:
    """The agent `name` that `build` returns. Its methods raise UserCodeError for errors in the
    user's code and for wrong return values."""

    def __init__(self, name: str, n_actions: int, build: Callable[[], Agent]) -> None:
        self._name, self._n_actions = f"agent {name!r}", n_actions
        with user_code_errors(self._name, "is built"):
            self._agent: Any = build()
        for method in ("act", "greedy", "observe", "learn", "end_episode"):
            if not callable(getattr(self._agent, method, None)):
                raise UserCodeError(f"{self._name}: method {method!r} is missing")

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """See `Agent`."""
        return self._action("act", state, exploring)

    def greedy(self, state: NDArray[np.float32]) -> int:
        """See `Agent`."""
        return self._action("greedy", state)

    def observe(self, transition: Transition) -> None:
        """See `Agent`."""
        self._call("observe", transition)

    def learn(self) -> float:
        """See `Agent`. A non-finite loss is allowed: the agent has diverged."""
        loss = self._call("learn")
        try:
            return float(loss)
        except (TypeError, ValueError):
            message = f"learn returned {loss!r} instead of a loss (0 if there is none)"
            raise UserCodeError(f"{self._name}: {message}") from None

    def end_episode(self) -> None:
        """See `Agent`."""
        self._call("end_episode")

    def _call(self, method: str, *arguments: Any) -> Any:
        with user_code_errors(self._name, f"runs {method}"):
            return getattr(self._agent, method)(*arguments)

    def _action(self, method: str, *arguments: Any) -> int:
        action = self._call(method, *arguments)
        try:
            return checked_action(action, self._n_actions)
        except InvalidInput as error:
            raise UserCodeError(f"{self._name}: {method}: {error}") from None
