"""Batches and order in which a pool's actors get their requests."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bilevel.evaluation import Centre, EvaluationRequest, Perturbed, TrainedOn
from bilevel.hyperparameters import load_recipe
from cluster.ray.queue import BATCHES, LONG, Batch, RequestQueue, batches
from tests.conftest import ddqn

AGENT = ddqn(load_recipe("paper", "CartPole-v0"))
STEP = AGENT.step_cost / AGENT.batch_size

MEMBER, MIRRORED, CENTRE = Perturbed(0, 1), Perturbed(0, -1), Centre()


def requests(costs: list[int], on: list[TrainedOn] | None = None) -> list[EvaluationRequest]:
    """One request per cost, which is proportional to the batch size."""
    pairs = zip(costs, on or [MEMBER] * len(costs), strict=True)
    return [
        EvaluationRequest(i, seed=i, agent=replace(AGENT, batch_size=cost), on=where)
        for i, (cost, where) in enumerate(pairs)
    ]


ON: tuple[TrainedOn, ...] = (CENTRE, MEMBER, MIRRORED)
places = st.sampled_from(ON)
some = st.lists(st.tuples(st.integers(1, 500), places), max_size=120).map(
    lambda pairs: requests([cost for cost, _ in pairs], [on for _, on in pairs])
)
actors = st.integers(1, 9)


class Course:
    """Actors that end or die in an order drawn by hypothesis."""

    def __init__(self, asked: list[EvaluationRequest], actors: int) -> None:
        self.queue = RequestQueue(asked, actors)
        self.held: list[list[Batch]] = [[] for _ in range(actors)]
        self.answered: list[int] = []

    def hand_out(self) -> None:
        for held in sorted(self.held, key=len):
            while (batch := self.queue.take(held)) is not None:
                held.append(batch)

    def busy(self) -> list[int]:
        return [i for i, held in enumerate(self.held) if held]

    def end(self, actor: int) -> None:
        batch = self.held[actor].pop(0)
        self.answered += [request.index for request in batch.requests]

    def die(self, actor: int) -> None:
        self.queue.put_back(self.held[actor])
        self.held[actor] = []


class TestBatches:
    @given(some, actors)
    def test_every_request_is_in_exactly_one(self, asked: list[EvaluationRequest], n: int) -> None:
        divided = batches(asked, n)
        indices = [request.index for batch in divided for request in batch.requests]
        assert sorted(indices) == list(range(len(asked)))
        assert [batch.index for batch in divided] == list(range(len(divided)))
        assert all(batch.requests for batch in divided)

    @given(some, actors)
    def test_longest_first_then_those_on_the_centre_last(
        self, asked: list[EvaluationRequest], n: int
    ) -> None:
        ordered = [request for batch in batches(asked, n) for request in batch.requests]
        keys = [
            (-request.agent.step_cost, request.on == CENTRE, request.index) for request in ordered
        ]
        assert keys == sorted(keys)

    @given(some, actors)
    def test_no_batch_is_much_longer_than_its_share(
        self, asked: list[EvaluationRequest], n: int
    ) -> None:
        """A batch is as close to its share of the remaining cost as whole requests allow."""
        left = sum(request.agent.step_cost for request in asked)
        for batch in batches(asked, n):
            without_last = batch.cost - batch.requests[-1].agent.step_cost
            assert without_last <= left / (n * BATCHES) * (1 + 1e-9)
            left -= batch.cost

    @pytest.mark.parametrize("n", [1, 2, 8])
    def test_many_equal_requests_are_in_ever_smaller_batches(self, n: int) -> None:
        sizes = [len(batch.requests) for batch in batches(requests([100] * (30 * n)), n)]
        assert sizes == sorted(sizes, reverse=True)
        assert sizes[0] == math.ceil(30 / BATCHES)
        assert sizes[-n:] == [1] * n
        assert len(sizes) < 20 * n

    def test_long_evaluations_come_one_by_one(self) -> None:
        """However many there are, so that little is lost when the driver ends."""
        wide = replace(AGENT, hidden_layers=3, hidden_size=384)
        assert wide.step_cost > LONG
        asked = [EvaluationRequest(i, seed=i, agent=wide) for i in range(90)]
        assert all(len(batch.requests) == 1 for batch in batches(asked, 1))
        small = [replace(one, index=90 + i, agent=AGENT) for i, one in enumerate(asked)]
        sizes = [len(batch.requests) for batch in batches([*asked, *small], 1)]
        assert sizes[:90] == [1] * 90
        assert max(sizes) > 1

    def test_few_requests_are_batches_of_one(self) -> None:
        assert [len(batch.requests) for batch in batches(requests([100] * 7), 2)] == [1] * 7


@given(some, actors, st.data())
def test_each_is_answered_once_and_nobody_idles_while_one_waits(
    asked: list[EvaluationRequest], n: int, data: st.DataObject
) -> None:
    course = Course(asked, n)
    course.hand_out()
    while busy := course.busy():
        assert len(busy) == n or not course.queue
        course.end(data.draw(st.sampled_from(busy)))
        course.hand_out()
    assert sorted(course.answered) == [request.index for request in asked]


@given(some, actors, st.data())
def test_what_dead_actors_held_is_answered_once_too(
    asked: list[EvaluationRequest], n: int, data: st.DataObject
) -> None:
    course, deaths = Course(asked, n), 0
    course.hand_out()
    while busy := course.busy():
        actor = data.draw(st.sampled_from(busy))
        if deaths < 5 and data.draw(st.booleans()):
            course.die(actor)
            deaths += 1
        else:
            course.end(actor)
        course.hand_out()
    assert sorted(course.answered) == [request.index for request in asked]


@given(st.lists(st.integers(1, 500), min_size=1, max_size=60), actors)
def test_early_only_while_all_stay_busy(costs: list[int], n: int) -> None:
    """The remaining batches keep all actors busy for longer than the early batch waits."""
    queue = RequestQueue(requests(costs), n)
    held = queue.take([])
    assert held is not None
    waiting = sum(costs) * STEP - held.cost
    early = queue.take([held])
    if early is not None:
        assert waiting / n > held.cost + early.cost
        assert queue.take([held, early]) is None


@pytest.mark.parametrize("n", [1, 2, 8])
def test_the_last_ones_go_to_whoever_is_free(n: int) -> None:
    queue = RequestQueue(requests([100] * 480), n)
    held = queue.take([])
    assert held is not None
    early = 0
    while queue.take([held]) is not None:
        early += 1
    assert len(queue) >= 2 * n
    assert early > 0


def test_what_a_dead_actor_held_comes_first_again() -> None:
    queue = RequestQueue(requests([3, 2, 1, 1, 1]), 1)
    held = [queue.take([]), queue.take([])]
    dead = [batch for batch in held if batch is not None]
    assert [batch.index for batch in dead] == [0, 1]
    queue.put_back(dead)
    taken = [batch.index for _ in range(5) if (batch := queue.take([])) is not None]
    assert taken == [0, 1, 2, 3, 4]
    assert queue.take([]) is None


def test_put_back_counts_as_waiting_again() -> None:
    """Then the decision about an early batch is the same as before."""
    queue, other = (RequestQueue(requests([100] * 64), 2) for _ in range(2))
    first = queue.take([])
    assert first is not None
    queue.put_back([first])
    for one in (queue, other):
        held = one.take([])
        assert held == first
        while one.take([held]) is not None:
            pass
    assert len(queue) == len(other)
