"""Batches and order in which a pool's actors get their requests, and how early.

The order does not affect results, since an evaluation is a function of its request alone. It
affects the time that actors wait for the driver and, at the end, for the slowest actor.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from bilevel.evaluation import Centre, EvaluationRequest

#: A batch holds one of BATCHES equal parts of an actor's share of the remaining requests. The first
#: batches are large, because a round trip to an actor costs about a millisecond and an evaluation
#: may take five; the last are single requests, so that the actors finish together (guided
#: self-scheduling; Polychronopoulos and Kuck, 1987).
BATCHES = 4

#: Expected cost, in multiplications per training step, from which no request joins a batch: eight
#: small agents, half a second or so. The results of longer evaluations come one by one, so that
#: little is lost when the driver ends.
LONG = 2e6

#: A busy actor gets its next batch early while the waiting batches would keep every actor busy for
#: this multiple of the cost of its two batches (docs/speed.md).
EARLY_MARGIN = 1.5


@dataclass(frozen=True)
class Batch:
    """Requests that one actor answers in one call."""

    index: int
    requests: tuple[EvaluationRequest, ...]

    @property
    def cost(self) -> float:
        """Expected cost, in multiplications per training step."""
        return sum(request.agent.step_cost for request in self.requests)


def batches(requests: Sequence[EvaluationRequest], actors: int) -> list[Batch]:
    """All requests, longest expected first, in batches of decreasing cost.

    A long evaluation must not begin last, when the other actors have nothing left to do (Graham,
    1969). The number of training steps is unknown (the SE is new), but the cost of a step is
    known, and agents on the unperturbed SE tend to stop sooner.
    """
    ordered = sorted(requests, key=lambda one: (-one.agent.step_cost, isinstance(one.on, Centre)))
    left = sum(one.agent.step_cost for one in ordered)
    divided: list[Batch] = []
    held: list[EvaluationRequest] = []
    for request in ordered:
        held.append(request)
        cost = sum(one.agent.step_cost for one in held)
        if cost * actors * BATCHES >= left or cost >= LONG:
            divided.append(Batch(len(divided), tuple(held)))
            held = []
            left -= cost
    return [*divided, Batch(len(divided), tuple(held))] if held else divided


class RequestQueue:
    """Batches that have not been sent to any of the `actors` actors."""

    def __init__(self, requests: Sequence[EvaluationRequest], actors: int) -> None:
        self._waiting = deque(batches(requests, actors))
        self._actors = actors
        self._cost = sum(batch.cost for batch in self._waiting)

    def __len__(self) -> int:
        return len(self._waiting)

    def take(self, held: Sequence[Batch]) -> Batch | None:
        """The next batch for an actor that holds the batches `held`, None if it gets none now.

        An idle actor gets a batch whenever one is waiting. An actor with one batch gets the next
        early, so that it need not wait for the driver, unless other actors could then run out of
        work before it begins that batch.
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
        """Put the batches of a dead actor back at the front of the queue."""
        self._waiting.extendleft(reversed(held))
        self._cost += sum(batch.cost for batch in held)
