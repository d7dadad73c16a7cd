"""Checks of agents that users write: what they return, and what they raise.

A mistake in such an agent must not become a score. It is told in one line with its place in the
user's file, wherever the evaluation runs.
"""

import inspect
import sysconfig
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.agent import Agent, Transition
from bilevel.errors import InvalidInput
from bilevel.tasks import checked_action

#: Folders of code that users did not write.
_LIBRARIES = tuple(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))


class AgentMistake(InvalidInput):
    """An agent returned what it must not, raised, or exited; the message tells where."""


class CheckedAgent:
    """The agent called `name` that `build` makes, with `n_actions` actions; its methods raise
    AgentMistake for any mistake."""

    def __init__(self, name: str, n_actions: int, build: Callable[[], Agent]) -> None:
        self._name = name
        self._n_actions = n_actions
        self._agent: Any = None
        with self._as_mistake("is built"):
            self._agent = build()
        for method in ("act", "greedy", "observe", "learn", "end_episode"):
            if not callable(getattr(self._agent, method, None)):
                raise self._mistake(type(self._agent), f"the method {method!r} is missing")

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """See `Agent`."""
        with self._as_mistake("acts"):
            action = self._agent.act(state, exploring)
        return self._action(action, "act")

    def greedy(self, state: NDArray[np.float32]) -> int:
        """See `Agent`."""
        with self._as_mistake("acts"):
            action = self._agent.greedy(state)
        return self._action(action, "greedy")

    def observe(self, transition: Transition) -> None:
        """See `Agent`."""
        with self._as_mistake("observes"):
            self._agent.observe(transition)

    def learn(self) -> float:
        """See `Agent`; a loss that is not finite is a number all the same: the agent diverges."""
        with self._as_mistake("learns"):
            loss = self._agent.learn()
            number = float(loss) if hasattr(loss, "__float__") else None
        if number is None:
            raise self._mistake(
                self._agent.learn, f"learn returned {loss!r} instead of a loss (0 if there is none)"
            )
        return number

    def end_episode(self) -> None:
        """See `Agent`."""
        with self._as_mistake("ends an episode"):
            self._agent.end_episode()

    def _action(self, action: Any, method: str) -> int:
        try:
            return checked_action(action, self._n_actions)
        except InvalidInput as error:
            function = getattr(self._agent, method)
            raise self._mistake(function, f"{method}: {error}") from None

    @contextmanager
    def _as_mistake(self, doing: str) -> Iterator[None]:
        """Within the block, errors and exits of the agent become an AgentMistake."""
        try:
            yield
        except (Exception, SystemExit) as error:
            what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            raise AgentMistake(
                f"agent {self._name!r}{self._place_of(error)}, when it {doing}: "
                f"{' '.join(what.split())}"
            ) from None

    def _mistake(self, where: Any, what: str) -> AgentMistake:
        source = inspect.unwrap(where)
        place = ""
        with suppress(OSError, TypeError):  # code without a file
            place = f" at {inspect.getsourcefile(source)}:{inspect.getsourcelines(source)[1]}"
        return AgentMistake(f"agent {self._name!r}{place}: {what}")

    def _place_of(self, error: BaseException) -> str:
        """The last call in the file of the agent's class, else in code that is no library's."""
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename != __file__]
        file = None
        with suppress(OSError, TypeError):
            file = inspect.getsourcefile(type(self._agent))
        own = [f for f in frames if f.filename == file]
        own = own or [f for f in frames if not f.filename.startswith(_LIBRARIES)]
        return f" at {own[-1].filename}:{own[-1].lineno}" if own else ""
