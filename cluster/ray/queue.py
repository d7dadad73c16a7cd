"""Division of requests into batches, and their order.

The order does not affect results, because an evaluation depends only on its request. It affects the
time that actors wait for the driver and, at the end, for the slowest actor.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from bilevel.evaluation import Centre, EvaluationRequest

#: A batch is 1 / BATCHES of an actor's share of the remaining requests (guided self-scheduling;
#: Polychronopoulos and Kuck, 1987). The first batches are large, because a round trip takes about a
#: millisecond and an evaluation may take five. The last batches are single requests, so that all
#: actors finish at about the same time.
BATCHES = 4

#: Expected cost, in multiplications per training step, above which a batch takes no more requests.
#: Eight small agents, about half a second, reach it. Results of expensive evaluations thus arrive
#: one by one, and little is lost if the driver ends.
LONG = 2e6

#: A busy actor gets its next batch early if the waiting batches keep all actors busy for at least
#: this multiple of the cost of its two batches (docs/speed.md).
EARLY_MARGIN = 1.5


@dataclass(frozen=True)
class Batch:
    """Requests that an actor evaluates in one call."""

    index: int
    requests: tuple[EvaluationRequest, ...]

    @property
    def cost(self) -> float:
        """Expected cost, in multiplications per training step."""
        return sum(request.agent.step_cost for request in self.requests)


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
            divided.append(Batch(len(divided), tuple(group)))
            group = []
            remaining -= cost
    return [*divided, Batch(len(divided), tuple(group))] if group else divided


class RequestQueue:
    """Batches that wait for one of `actors` actors."""

    def __init__(self, requests: Sequence[EvaluationRequest], actors: int) -> None:
        self._waiting = deque(batches(requests, actors))
        self._actors = actors
        self._cost = sum(batch.cost for batch in self._waiting)

    def __len__(self) -> int:
        return len(self._waiting)

    def take(self, held: Sequence[Batch]) -> Batch | None:
        """Return the next batch for an actor that holds the batches `held`, or None.

        An idle actor gets a batch whenever one is waiting. An actor with one batch gets the next
        batch early, so that it does not wait for the driver, unless other actors could run out of
        work before it starts that batch.
        """
        if not self._waiting or len(held) > 1:
            return None
        batch = self._waiting[0]
        if held:
            kept_busy = self._cost / self._actors
            if kept_busy < EARLY_MARGIN * (held[0].cost + batch.cost):
                return None
        self._waiting.popleft()
        self._cost -= batch.cost
        return batch

    def put_back(self, held: Sequence[Batch]) -> None:
        """Return the batches of a dead actor to the front of the queue."""
        self._waiting.extendleft(reversed(held))
        self._cost += sum(batch.cost for batch in held)
