"""In which batches and order a pool's actors get their requests, and how early.

Results do not depend on it, an evaluation being a function of its request alone; the
time does, by what actors wait for the driver and, at the end, for the slowest of them.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from bilevel.evaluation import Centre, EvaluationRequest

#: A batch is one of so many an actor into which the requests that are left would be divided: large
#: ones first, because a round trip to an actor costs about a millisecond and an evaluation may
#: take five, and at the end single requests, so that the actors finish together (guided
#: self-scheduling; Polychronopoulos and Kuck, 1987).
BATCHES = 4

#: A busy actor gets its next batch early while all that wait would keep every actor
#: busy for so many times what that one would then have to do (docs/speed.md).
EARLY_MARGIN = 1.5


@dataclass(frozen=True)
class Batch:
    """Requests that one actor answers in one call."""

    index: int
    requests: tuple[EvaluationRequest, ...]

    @property
    def cost(self) -> float:
        """Expected, in multiplications a training step."""
        return sum(request.agent.step_cost for request in self.requests)


def batches(requests: Sequence[EvaluationRequest], actors: int) -> list[Batch]:
    """All requests, longest expected first, in batches of ever less cost.

    What is long must not begin last, when the other actors have nothing left to do
    (Graham, 1969). How many steps an agent will train is not known (its SE is new),
    but what a step costs is; and agents on the unperturbed SE tend to stop sooner.
    """
    ordered = sorted(requests, key=lambda one: (-one.agent.step_cost, isinstance(one.on, Centre)))
    left = sum(one.agent.step_cost for one in ordered)
    divided: list[Batch] = []
    held: list[EvaluationRequest] = []
    for request in ordered:
        held.append(request)
        cost = sum(one.agent.step_cost for one in held)
        if cost * actors * BATCHES >= left:
            divided.append(Batch(len(divided), tuple(held)))
            held = []
            left -= cost
    return [*divided, Batch(len(divided), tuple(held))] if held else divided


class RequestQueue:
    """Batches that none of `actors` actors has yet."""

    def __init__(self, requests: Sequence[EvaluationRequest], actors: int) -> None:
        self._waiting = deque(batches(requests, actors))
        self._actors = actors
        self._cost = sum(batch.cost for batch in self._waiting)

    def __len__(self) -> int:
        return len(self._waiting)

    def take(self, held: Sequence[Batch]) -> Batch | None:
        """The next batch for an actor that holds these, None if it gets none now.

        One that holds nothing gets a batch whenever there is one. One that holds one
        gets the next early, so that it need not wait for the driver between the two,
        unless others may then be idle before it has begun that.
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
        """What an actor held when it died comes first again."""
        self._waiting.extendleft(reversed(held))
        self._cost += sum(batch.cost for batch in held)
