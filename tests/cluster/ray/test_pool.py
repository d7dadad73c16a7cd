"""Batches of requests."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bilevel.evaluation import Centre, EvaluationRequest, Perturbed, TrainedOn
from bilevel.recipes import load_recipe
from cluster.ray.pool import BATCHES, LONG, batches
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


@given(some_requests, st.integers(1, 9))
def test_batches_contain_each_request_once_and_the_most_expensive_first(
    asked: list[EvaluationRequest], actors: int
) -> None:
    ordered = [request for batch in batches(asked, actors) for request in batch]
    assert sorted(request.index for request in ordered) == list(range(len(asked)))
    keys = [(-r.agent.step_cost, r.on == Centre(), r.index) for r in ordered]
    assert keys == sorted(keys)


@pytest.mark.parametrize("actors", [1, 2, 8])
def test_batches_of_equal_requests_shrink_to_single_requests(actors: int) -> None:
    sizes = [len(batch) for batch in batches(requests([100] * (30 * actors)), actors)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == math.ceil(30 / BATCHES)
    assert sizes[-actors:] == [1] * actors
    assert len(sizes) < 20 * actors


def test_long_evaluations_are_sent_one_by_one() -> None:
    wide = replace(AGENT, hidden_layers=3, hidden_size=384)
    assert wide.step_cost > LONG
    asked = [EvaluationRequest(i, seed=i, agent=wide) for i in range(90)]
    small = [EvaluationRequest(90 + i, seed=i, agent=AGENT) for i in range(90)]
    sizes = [len(batch) for batch in batches([*asked, *small], 1)]
    assert sizes[:90] == [1] * 90
    assert max(sizes) > 1
