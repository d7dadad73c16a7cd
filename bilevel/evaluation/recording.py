"""The transitions of one evaluation, for pictures of what an agent saw."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from bilevel.agents.agent import Agent, Transition
from bilevel.agents.checked import CheckedAgent


@dataclass(frozen=True)
class Recording:
    """The transitions of an agent's training and tests."""

    training: list[Transition] = field(default_factory=list)
    tests: list[Transition] = field(default_factory=list)

    def keeping(self, tests: Iterator[list[Transition]]) -> Iterator[list[Transition]]:
        """The transitions of each test episode, which are kept as they come."""
        for episode in tests:
            self.tests.extend(episode)
            yield episode


class RecordedAgent(CheckedAgent):
    """An agent that adds what it observes to `observed`."""

    def __init__(
        self, name: str, n_actions: int, build: Callable[[], Agent], observed: list[Transition]
    ) -> None:
        super().__init__(name, n_actions, build)
        self._observed = observed

    def observe(self, transition: Transition) -> None:
        """See `Agent`."""
        self._observed.append(transition)
        super().observe(transition)
