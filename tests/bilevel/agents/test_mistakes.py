"""Mistakes in users' agents are reported with their location, and never become a score."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bilevel.agents import AgentHyperparameters, hyperparameters, register_agent
from bilevel.evaluation import train_and_test
from bilevel.tasks import Task
from bilevel.user_code import UserCodeError


@hyperparameters
class Mistaken(AgentHyperparameters, agent="test-mistaken"):
    """Short training and tests."""


class Correct:
    """An agent without a mistake, which diverges later."""

    def __init__(self, *_: Any) -> None:
        pass

    def act(self, state: Any, exploring: bool) -> Any:
        return np.int64(1)

    def greedy(self, state: Any) -> Any:
        return 0

    def observe(self, transition: Any) -> None:
        pass

    def learn(self) -> Any:
        return 0.0

    def end_episode(self) -> None:
        pass


def fails(*_: Any) -> Any:
    raise KeyError("size")


def singular(*_: Any) -> Any:
    np.linalg.inv(np.zeros((2, 2)))


def exits(*_: Any) -> Any:
    raise SystemExit(3)


def evaluated(task: Task, changes: dict[str, Any]) -> Any:
    kind: Any = type("Wrong", (Correct,), changes | {"__module__": __name__})
    register_agent(Mistaken, kind)
    hp = replace(Mistaken(), max_episodes=2, init_episodes=1, test_episodes=1)
    return train_and_test(task, None, hp, 0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"__init__": fails}, "KeyError: 'size'"),
        ({"act": lambda *_: 2}, "action 2 is not allowed: allowed are 0 to 1"),
        ({"act": lambda *_: None}, "action None is not allowed"),
        ({"greedy": lambda *_: -1}, "action -1 is not allowed"),
        ({"observe": singular}, "LinAlgError: Singular matrix"),
        ({"learn": lambda *_: None}, "TypeError: .*NoneType"),
        ({"end_episode": exits}, "SystemExit: 3"),
        ({"end_episode": None}, "TypeError: 'NoneType' object is not callable"),
    ],
)
def test_a_mistake_is_reported_in_one_line(
    changes: dict[str, Any], message: str, cartpole: Task
) -> None:
    with pytest.raises(
        UserCodeError, match=rf"^agent 'test-mistaken'.*, when it runs: .*{message}.*$"
    ):
        evaluated(cartpole, changes)


def test_a_message_names_file_and_line(cartpole: Task) -> None:
    line = fails.__code__.co_firstlineno + 1
    with pytest.raises(UserCodeError, match=rf"test_mistakes.py:{line}, when it runs: KeyError"):
        evaluated(cartpole, {"learn": fails})


def test_agents_without_mistakes(cartpole: Task) -> None:
    assert evaluated(cartpole, {}).finite
    assert not evaluated(cartpole, {"learn": lambda _: math.nan}).finite
