"""Mistakes in users' agents are reported with their location, and never become a score."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bilevel.agents import Transition
from bilevel.agents.checked import CheckedAgent
from bilevel.user_code import UserCodeError

STATE = np.zeros(4, np.float32)


class Correct:
    """An agent without a mistake."""

    def act(self, state: Any, exploring: bool) -> Any:
        return np.int64(1)

    def greedy(self, state: Any) -> Any:
        return 0

    def observe(self, transition: Any) -> None:
        pass

    def learn(self) -> Any:
        return math.nan

    def end_episode(self) -> None:
        pass


class FailsToBuild(Correct):
    def __init__(self) -> None:
        raise KeyError("size")


class ActsOutOfRange(Correct):
    def act(self, state: Any, exploring: bool) -> Any:
        return 2


class ActsNegative(Correct):
    def greedy(self, state: Any) -> Any:
        return -1


class Decorated(Correct):
    @torch.no_grad()
    def act(self, state: Any, exploring: bool) -> Any:
        return None


class Raises(Correct):
    def greedy(self, state: Any) -> Any:
        return np.zeros(2)[5]


class RaisesInALibrary(Correct):
    def observe(self, transition: Any) -> None:
        np.linalg.inv(np.zeros((2, 2)))


class ReturnsNoLoss(Correct):
    def learn(self) -> Any:
        return None


class Exits(Correct):
    def end_episode(self) -> None:
        raise SystemExit(3)


class Unfinished(Correct):
    end_episode: Any = None


def run(agent: CheckedAgent) -> tuple[int, float]:
    """Run an episode of one step, and a test; return training action and loss."""
    action = agent.act(STATE, True)
    agent.observe(Transition(STATE, action, 1.0, STATE, 0.0))
    loss = agent.learn()
    agent.end_episode()
    agent.greedy(STATE)
    return action, loss


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (FailsToBuild, ", when it is built: KeyError: 'size'"),
        (ActsOutOfRange, ": act: action 2 is not allowed: allowed are the integers 0 to 1"),
        (ActsNegative, ": greedy: action -1 is not allowed: allowed are the integers 0 to 1"),
        (Decorated, ": act: action None is not allowed: allowed are the integers 0 to 1"),
        (Raises, ", when it runs greedy: IndexError: index 5 is out of bounds"),
        (RaisesInALibrary, ", when it runs observe: LinAlgError: Singular matrix"),
        (ReturnsNoLoss, ": learn returned None instead of a loss (0 if there is none)"),
        (Exits, ", when it runs end_episode: SystemExit: 3"),
        (Unfinished, ": method 'end_episode' is missing"),
    ],
)
def test_a_mistake_is_reported_in_one_line_with_its_location(
    kind: type[Correct], message: str
) -> None:
    with pytest.raises(UserCodeError) as caught:
        run(CheckedAgent("mine", 2, kind))
    prefix = f"agent 'mine' at {__file__}:"
    assert str(caught.value).startswith(prefix)
    line = str(caught.value).removeprefix(prefix)
    number = int("".join(c for c in line[:4] if c.isdigit()))
    assert line.removeprefix(str(number)).startswith(message)
    # The line is in the class.
    lines = Path(__file__).read_text().splitlines()
    assert f"class {kind.__name__}(Correct):" in lines[number - 4 : number]


def test_an_agent_without_mistakes_is_unchanged() -> None:
    action, loss = run(CheckedAgent("mine", 2, Correct))
    assert (action, type(action)) == (1, int)
    assert math.isnan(loss)  # it diverges later
