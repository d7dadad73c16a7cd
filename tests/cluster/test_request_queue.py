"""The order in which a pool's actors get their requests."""

from dataclasses import replace
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bilevel.evaluation import EvaluationRequest
from bilevel.hyperparameters import DDQNHyperparameters, load_preset
from cluster.request_queue import FitRequest, RequestQueue

AGENT = cast(DDQNHyperparameters, load_preset("tuned", "CartPole-v0").agents[0])
STEP = AGENT.step_cost / AGENT.batch_size


def requests(costs: list[int], signs: list[int]) -> list[EvaluationRequest]:
    """One a cost, which is in proportion to the batch size."""
    return [
        EvaluationRequest(i, seed=i, agent=replace(AGENT, batch_size=cost), sign=sign)
        for i, (cost, sign) in enumerate(zip(costs, signs, strict=True))
    ]


some = st.lists(st.tuples(st.integers(1, 500), st.sampled_from((0, 1, -1))), max_size=60).map(
    lambda pairs: requests([cost for cost, _ in pairs], [sign for _, sign in pairs])
)
actors = st.integers(1, 9)


class Course:
    """Actors that end evaluations in an order drawn by hypothesis."""

    def __init__(self, queue: RequestQueue[EvaluationRequest], actors: int) -> None:
        self.queue = queue
        self.held: list[list[EvaluationRequest]] = [[] for _ in range(actors)]
        self.order: list[int] = []

    def hand_out(self) -> None:
        for held in sorted(self.held, key=len):
            while (request := self.queue.take(held)) is not None:
                held.append(request)
                self.order.append(request.index)

    def busy(self) -> list[int]:
        return [i for i, held in enumerate(self.held) if held]


@given(some, actors, st.data())
def test_each_is_answered_once_and_nobody_idles_while_one_waits(
    asked: list[EvaluationRequest], n: int, data: st.DataObject
) -> None:
    course = Course(RequestQueue(asked, n), n)
    answered = []
    course.hand_out()
    while busy := course.busy():
        assert len(busy) == n or not course.queue
        ends = data.draw(st.sampled_from(busy))
        answered.append(course.held[ends].pop(0).index)
        course.hand_out()
    assert sorted(answered) == [request.index for request in asked]


@given(some, actors)
def test_longest_first_then_those_on_psi_last(asked: list[EvaluationRequest], n: int) -> None:
    queue = RequestQueue(asked, n)
    taken = [request for _ in asked if (request := queue.take([])) is not None]
    keys = [(-request.agent.step_cost, request.sign == 0, request.index) for request in taken]
    assert keys == sorted(keys)


@given(st.lists(st.integers(1, 500), min_size=1, max_size=60), actors)
def test_early_only_while_all_stay_busy(costs: list[int], n: int) -> None:
    """What is left keeps everybody busy for longer than the early request has to wait."""
    queue = RequestQueue(requests(costs, [1] * len(costs)), n)
    held = queue.take([])
    assert held is not None
    waiting = sorted(costs, reverse=True)[1:]
    early = queue.take([held])
    if early is not None:
        assert sum(waiting) / n * STEP > held.agent.step_cost + early.agent.step_cost
        assert queue.take([held, early]) is None


@pytest.mark.parametrize("n", [1, 2, 8])
def test_the_last_ones_go_to_whoever_is_free(n: int) -> None:
    queue = RequestQueue(requests([100] * 48, [1] * 48), n)
    held = queue.take([])
    assert held is not None
    early = 0
    while queue.take([held]) is not None:
        early += 1
    assert len(queue) >= 2 * n
    assert early > 0


def test_what_a_dead_actor_held_comes_first_again() -> None:
    queue = RequestQueue(requests([3, 2, 1, 1, 1], [1] * 5), 1)
    held = [queue.take([]), queue.take([])]
    dead = [request for request in held if request is not None]
    assert [request.index for request in dead] == [0, 1]
    queue.put_back(dead)
    taken = [request.index for _ in range(5) if (request := queue.take([])) is not None]
    assert taken == [0, 1, 2, 3, 4]
    assert queue.take([]) is None


def test_fits_are_handed_out_in_turn() -> None:
    asked = [FitRequest(number, seed=100 - number) for number in range(5)]
    queue = RequestQueue(asked, 2)
    assert [queue.take([]) for _ in asked] == asked
