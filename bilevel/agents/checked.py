"""Checks of agents that users write: what they return, and what they raise."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.agent import Agent, Transition
from bilevel.errors import InvalidInput
from bilevel.tasks import checked_action
from bilevel.user_code import as_mistake, mistake_at


class CheckedAgent:
    """The agent called `name` that `build` makes, with `n_actions` actions; its methods raise
    Mistake for any mistake."""

    def __init__(self, name: str, n_actions: int, build: Callable[[], Agent]) -> None:
        self._what = f"agent {name!r}"
        self._n_actions = n_actions
        with as_mistake(self._what, getattr(build, "func", build), "is built"):
            self._agent: Any = build()
        for method in ("act", "greedy", "observe", "learn", "end_episode"):
            if not callable(getattr(self._agent, method, None)):
                raise mistake_at(self._what, type(self._agent), f"the method {method!r} is missing")

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """See `Agent`."""
        with self._calling("act", "acts"):
            action = self._agent.act(state, exploring)
        return self._action(action, "act")

    def greedy(self, state: NDArray[np.float32]) -> int:
        """See `Agent`."""
        with self._calling("greedy", "acts"):
            action = self._agent.greedy(state)
        return self._action(action, "greedy")

    def observe(self, transition: Transition) -> None:
        """See `Agent`."""
        with self._calling("observe", "observes"):
            self._agent.observe(transition)

    def learn(self) -> float:
        """See `Agent`; a loss that is not finite is a number all the same: the agent diverges."""
        with self._calling("learn", "learns"):
            loss = self._agent.learn()
            number = float(loss) if hasattr(loss, "__float__") else None
        if number is None:
            raise mistake_at(
                self._what,
                self._agent.learn,
                f"learn returned {loss!r} instead of a loss (0 if there is none)",
            )
        return number

    def end_episode(self) -> None:
        """See `Agent`."""
        with self._calling("end_episode", "ends an episode"):
            self._agent.end_episode()

    def _calling(self, method: str, doing: str) -> AbstractContextManager[None]:
        return as_mistake(self._what, getattr(self._agent, method), doing)

    def _action(self, action: Any, method: str) -> int:
        try:
            return checked_action(action, self._n_actions)
        except InvalidInput as error:
            message = f"{method}: {error}"
            raise mistake_at(self._what, getattr(self._agent, method), message) from None
