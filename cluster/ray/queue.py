"""Division of evaluation requests into batches, and their order.

The order does not affect results, because an evaluation depends only on its request. It affects the
time that actors wait for the driver and, at the end, for the slowest actor.
"""

from collections.abc import Sequence

from bilevel.evaluation import Centre, EvaluationRequest

#: Requests that an actor evaluates in one call.
Batch = tuple[EvaluationRequest, ...]

#: A batch is 1 / BATCHES of an actor's share of the remaining requests (guided self-scheduling;
#: Polychronopoulos and Kuck, 1987). The first batches are large, because a round trip takes about a
#: millisecond and an evaluation may take five. The last batches are single requests, so that all
#: actors finish at about the same time.
BATCHES = 4

#: Expected cost, in multiplications per training step, above which a batch takes no more requests.
#: Eight small agents, about half a second, reach it. Results of expensive evaluations thus arrive
#: one by one, and little is lost if the driver ends.
LONG = 2e6


def batches(requests: Sequence[EvaluationRequest], actors: int) -> list[Batch]:
    """Return all requests in batches of decreasing cost, the most expensive requests first.

    Longest processing time first avoids that an actor starts a long evaluation when the other
    actors have finished (Graham, 1969). Only the cost of a training step is known in advance.
    Agents on the unperturbed SE come last because they tend to stop sooner.
    """
    ordered = sorted(
        requests,
        key=lambda request: (-request.agent.step_cost, isinstance(request.on, Centre)),
    )
    remaining = sum(request.agent.step_cost for request in ordered)
    divided: list[Batch] = []
    group: list[EvaluationRequest] = []
    for request in ordered:
        group.append(request)
        cost = sum(member.agent.step_cost for member in group)
        if cost * actors * BATCHES >= remaining or cost >= LONG:
            divided.append(tuple(group))
            group = []
            remaining -= cost
    return [*divided, tuple(group)] if group else divided
