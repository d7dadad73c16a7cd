"""Checks of agents that users write: what they return, and what they raise.

A mistake in such an agent must not become a score. It is told in one line with its place in the
user's file, wherever the evaluation runs.
"""

import inspect
import math
import numbers
import operator
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.agent import Agent, Transition
from bilevel.errors import InvalidInput

#: Folders of code that users did not write.
_LIBRARIES = {"site-packages", "dist-packages"}


class AgentMistake(InvalidInput):
    """An agent returned what it must not, raised, or exited; the message tells where."""


class CheckedAgent:
    """The agent called `name` that `build` makes, with `n_actions` actions; its methods raise
    AgentMistake for any mistake."""

    def __init__(self, name: str, n_actions: int, build: Callable[[], Agent]) -> None:
        self._name = name
        self._n_actions = n_actions
        self._agent: Any = None
        self._has_learned = False
        with self._told("is built"):
            self._agent = build()

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """See `Agent`."""
        with self._told("acts"):
            action = self._agent.act(state, exploring)
        return self._action(action, "act")

    def greedy(self, state: NDArray[np.float32]) -> int:
        """See `Agent`."""
        with self._told("acts"):
            action = self._agent.greedy(state)
        return self._action(action, "greedy")

    def observe(self, transition: Transition) -> None:
        """See `Agent`."""
        with self._told("observes"):
            self._agent.observe(transition)

    def learn(self) -> float:
        """See `Agent`. An agent may diverge, but its first loss must be finite."""
        with self._told("learns"):
            loss = self._agent.learn()
        if isinstance(loss, numbers.Real) and (self._has_learned or math.isfinite(loss)):
            self._has_learned = True
            return float(loss)
        raise self._mistake("learn", f"returned {loss!r} instead of a finite loss (0 if none)")

    def end_episode(self) -> None:
        """See `Agent`."""
        with self._told("ends an episode"):
            self._agent.end_episode()

    def _action(self, action: Any, method: str) -> int:
        try:
            number = operator.index(action)
        except TypeError:
            number = -1
        if not 0 <= number < self._n_actions:
            allowed = f"allowed are the integers 0 to {self._n_actions - 1}"
            raise self._mistake(method, f"returned the action {action!r}: {allowed}")
        return number

    @contextmanager
    def _told(self, doing: str) -> Iterator[None]:
        """Within the block, errors and exits of the agent become an AgentMistake."""
        try:
            yield
        except (Exception, SystemExit) as error:
            frames = traceback.extract_tb(error.__traceback__)
            place = _users(frames[1:] or frames)
            what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            raise AgentMistake(
                f"agent {self._name!r} at {place.filename}:{place.lineno}, when it {doing}: "
                f"{' '.join(what.split())}"
            ) from None

    def _mistake(self, method: str, what: str) -> AgentMistake:
        function = getattr(type(self._agent), method)
        file = inspect.getsourcefile(function)
        line = inspect.getsourcelines(function)[1]
        return AgentMistake(f"agent {self._name!r} at {file}:{line}: {method} {what}")


def _users(frames: list[traceback.FrameSummary]) -> traceback.FrameSummary:
    """The last call in the user's own code, rather than in a library that it calls."""
    own = [f for f in frames if not _LIBRARIES & set(Path(f.filename).parts)]
    return (own or frames)[-1]
