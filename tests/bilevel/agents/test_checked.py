"""Mistakes of agents that users write are told with their place, and never become a score."""

import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bilevel.agents import Transition
from bilevel.agents.checked import CheckedAgent
from bilevel.user_code import Mistake


class Right:
    """An agent without a mistake."""

    def __init__(self) -> None:
        self.losses = [0.5, math.nan]

    def act(self, state: Any, exploring: bool) -> Any:
        return np.int64(1)

    def greedy(self, state: Any) -> Any:
        return 0

    def observe(self, transition: Any) -> None:
        pass

    def learn(self) -> Any:
        return self.losses.pop(0)

    def end_episode(self) -> None:
        pass


class Unbuilt(Right):
    def __init__(self) -> None:
        raise KeyError("size")


class ActsWrong(Right):
    def act(self, state: Any, exploring: bool) -> Any:
        return 2


class ActsNegative(Right):
    def greedy(self, state: Any) -> Any:
        return -1


class ActsHalf(Right):
    def act(self, state: Any, exploring: bool) -> Any:
        return 0.5


class Raises(Right):
    def greedy(self, state: Any) -> Any:
        return np.zeros(2)[5]


class RaisesInALibrary(Right):
    def observe(self, transition: Any) -> None:
        np.linalg.inv(np.zeros((2, 2)))


class LearnsNothing(Right):
    def learn(self) -> Any:
        return None


class LearnsText(Right):
    def learn(self) -> Any:
        return "well"


class Decorated(Right):
    @torch.no_grad()
    def act(self, state: Any, exploring: bool) -> Any:
        return None


class RaisesInTheStandardLibrary(Right):
    def observe(self, transition: Any) -> None:
        random.sample([1], 3)


class Exits(Right):
    def end_episode(self) -> None:
        raise SystemExit(3)


class Unfinished(Right):
    end_episode: Any = None


STATE = np.zeros(4, np.float32)


def live(agent: CheckedAgent) -> None:
    """An episode of one step, and a test."""
    action = agent.act(STATE, True)
    agent.observe(Transition(STATE, action, 1.0, STATE, 0.0))
    agent.learn()
    agent.end_episode()
    agent.greedy(STATE)


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        (Unbuilt, "when it is built: KeyError: 'size'"),
        (ActsWrong, "act: action 2 is not allowed: allowed are the integers 0 to 1"),
        (ActsNegative, "greedy: action -1 is not allowed: allowed are the integers 0 to 1"),
        (ActsHalf, "act: action 0.5 is not allowed: allowed are the integers 0 to 1"),
        (Raises, "when it acts: IndexError: index 5 is out of bounds for axis 0 with size 2"),
        (RaisesInALibrary, "when it observes: LinAlgError: Singular matrix"),
        (LearnsNothing, "learn returned None instead of a loss (0 if there is none)"),
        (LearnsText, "learn returned 'well' instead of a loss (0 if there is none)"),
        (Decorated, "act: action None is not allowed: allowed are the integers 0 to 1"),
        (
            RaisesInTheStandardLibrary,
            "when it observes: ValueError: Sample larger than population or is negative",
        ),
        (Unfinished, "the method 'end_episode' is missing"),
        (Exits, "when it ends an episode: SystemExit: 3"),
    ],
)
def test_a_mistake_is_told_in_one_line_with_its_place(kind: type[Right], told: str) -> None:
    with pytest.raises(Mistake) as caught:
        live(CheckedAgent("mine", 2, kind))
    place, _, what = str(caught.value).partition(", " if "when" in told else ": ")
    assert what == told
    assert place.startswith(f"agent 'mine' at {__file__}:")
    # the line lies in the class itself
    lines = Path(__file__).read_text().splitlines()
    line = int(place.rpartition(":")[2])
    assert f"class {kind.__name__}(Right):" in lines[line - 4 : line]


def test_an_agent_without_mistakes_is_left_alone() -> None:
    agent = CheckedAgent("mine", 2, Right)
    assert agent.act(STATE, False) == 1
    assert type(agent.act(STATE, False)) is int
    assert agent.learn() == 0.5
    assert math.isnan(agent.learn())  # it diverges later
