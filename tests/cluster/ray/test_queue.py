"""Batches of requests, and when actors get them."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bilevel.evaluation import Centre, EvaluationRequest, Perturbed, TrainedOn
from bilevel.recipes import load_recipe
from cluster.ray.queue import BATCHES, LONG, Batch, RequestQueue, batches
from tests.conftest import ddqn

AGENT = ddqn(load_recipe("paper", "CartPole-v0"))
ON: tuple[TrainedOn, ...] = (Centre(), Perturbed(0, 1), Perturbed(0, -1))


def requests(costs: list[int], on: list[TrainedOn] | None = None) -> list[EvaluationRequest]:
    """Return one request per cost, which is proportional to the batch size."""
    pairs = zip(costs, on or [ON[1]] * len(costs), strict=True)
    return [
        EvaluationRequest(i, seed=i, agent=replace(AGENT, batch_size=cost), on=where)
        for i, (cost, where) in enumerate(pairs)
    ]


some_requests = st.lists(st.tuples(st.integers(1, 500), st.sampled_from(ON)), max_size=120).map(
    lambda pairs: requests([cost for cost, _ in pairs], [on for _, on in pairs])
)
numbers_of_actors = st.integers(1, 9)


@given(some_requests, numbers_of_actors)
def test_batches_contain_each_request_once_and_the_most_expensive_first(
    asked: list[EvaluationRequest], actors: int
) -> None:
    divided = batches(asked, actors)
    assert [batch.index for batch in divided] == list(range(len(divided)))
    assert all(batch.requests for batch in divided)
    ordered = [request for batch in divided for request in batch.requests]
    assert sorted(request.index for request in ordered) == list(range(len(asked)))
    keys = [(-r.agent.step_cost, r.on == Centre(), r.index) for r in ordered]
    assert keys == sorted(keys)


@given(some_requests, numbers_of_actors)
def test_no_batch_exceeds_its_share_by_more_than_one_request(
    asked: list[EvaluationRequest], actors: int
) -> None:
    remaining = sum(request.agent.step_cost for request in asked)
    for batch in batches(asked, actors):
        without_last = batch.cost - batch.requests[-1].agent.step_cost
        assert without_last <= remaining / (actors * BATCHES) * (1 + 1e-9)
        remaining -= batch.cost


@pytest.mark.parametrize("actors", [1, 2, 8])
def test_batches_of_equal_requests_shrink_to_single_requests(actors: int) -> None:
    sizes = [len(batch.requests) for batch in batches(requests([100] * (30 * actors)), actors)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == math.ceil(30 / BATCHES)
    assert sizes[-actors:] == [1] * actors
    assert len(sizes) < 20 * actors


def test_long_evaluations_are_sent_one_by_one() -> None:
    wide = replace(AGENT, hidden_layers=3, hidden_size=384)
    assert wide.step_cost > LONG
    asked = [EvaluationRequest(i, seed=i, agent=wide) for i in range(90)]
    small = [EvaluationRequest(90 + i, seed=i, agent=AGENT) for i in range(90)]
    sizes = [len(batch.requests) for batch in batches([*asked, *small], 1)]
    assert sizes[:90] == [1] * 90
    assert max(sizes) > 1


@given(some_requests, numbers_of_actors, st.data())
def test_each_request_finishes_once_although_actors_die(
    asked: list[EvaluationRequest], actors: int, data: st.DataObject
) -> None:
    """No actor is idle while a batch waits."""
    queue = RequestQueue(asked, actors)
    held: list[list[Batch]] = [[] for _ in range(actors)]
    finished: list[int] = []
    deaths = 0
    while True:
        for batches_of_actor in sorted(held, key=len):
            while (batch := queue.take(batches_of_actor)) is not None:
                batches_of_actor.append(batch)
        busy = [i for i in range(actors) if held[i]]
        if not busy:
            break
        assert len(busy) == actors or not queue
        actor = data.draw(st.sampled_from(busy))
        if deaths < 5 and data.draw(st.booleans()):
            queue.put_back(held[actor])
            held[actor] = []
            deaths += 1
        else:
            finished += [request.index for request in held[actor].pop(0).requests]
    assert sorted(finished) == [request.index for request in asked]


@given(st.lists(st.integers(1, 500), min_size=1, max_size=60), numbers_of_actors)
def test_an_early_batch_leaves_enough_work_for_the_other_actors(
    costs: list[int], actors: int
) -> None:
    queue = RequestQueue(requests(costs), actors)
    held = queue.take([])
    assert held is not None
    waiting = sum(batch.cost for batch in batches(requests(costs), actors)) - held.cost
    early = queue.take([held])
    if early is not None:
        assert waiting / actors > held.cost + early.cost
        assert queue.take([held, early]) is None


@pytest.mark.parametrize("actors", [1, 2, 8])
def test_the_last_batches_go_to_idle_actors(actors: int) -> None:
    queue = RequestQueue(requests([100] * 480), actors)
    held = queue.take([])
    assert held is not None
    early = 0
    while queue.take([held]) is not None:
        early += 1
    assert len(queue) >= 2 * actors
    assert early > 0


def test_batches_of_a_dead_actor_are_taken_first() -> None:
    queue, untouched = (RequestQueue(requests([100] * 64), 2) for _ in range(2))
    dead = [batch for batch in (queue.take([]), queue.take([])) if batch is not None]
    queue.put_back(dead)
    for _ in range(len(untouched)):
        assert queue.take([]) == untouched.take([])
    assert queue.take([]) is None
