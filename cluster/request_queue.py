"""In which order a pool's actors get their requests, and how early.

Results do not depend on it, an evaluation being a function of its request alone; the
time does, by what actors wait for the driver and, at the end, for the slowest of them.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from bilevel.evaluation import EvaluationRequest

#: A busy actor gets its next request early while all that wait would keep every actor
#: busy for so many times what that one would then have to do (docs/speed.md).
EARLY_MARGIN = 1.5


@dataclass(frozen=True)
class FitRequest:
    """An SE is to be fitted to the task, by this seed."""

    index: int  # among those that are asked for together
    seed: int


#: What an actor is asked for.
Request = TypeVar("Request", EvaluationRequest, FitRequest)


class RequestQueue(Generic[Request]):
    """Requests that none of `actors` actors has yet, longest expected first.

    What is long must not begin last, when the other actors have nothing left to do
    (Graham, 1969). How many steps an agent will train is not known (its SE is new),
    but what a step costs is; and agents on psi itself tend to stop sooner than those on
    psi +- eps.
    """

    def __init__(self, requests: Sequence[Request], actors: int) -> None:
        ordered = sorted(requests, key=lambda request: (-_cost(request), _on_psi(request)))
        self._waiting: deque[Request] = deque(ordered)
        self._actors = actors
        self._cost = sum(map(_cost, ordered))

    def __len__(self) -> int:
        return len(self._waiting)

    def take(self, held: Sequence[Request]) -> Request | None:
        """The next request for an actor that holds these, None if it gets none now.

        One that holds nothing gets a request whenever there is one. One that holds one
        gets the next early, so that it need not wait for the driver between the two,
        unless others may then be idle before it has begun that.
        """
        if not self._waiting or len(held) > 1:
            return None
        request = self._waiting[0]
        if held:
            kept_busy = self._cost / self._actors
            if kept_busy < EARLY_MARGIN * (_cost(held[0]) + _cost(request)):
                return None
        self._waiting.popleft()
        self._cost -= _cost(request)
        return request

    def put_back(self, requests: Sequence[Request]) -> None:
        """What an actor held when it died comes first again."""
        self._waiting.extendleft(reversed(requests))
        self._cost += sum(map(_cost, requests))


def _cost(request: EvaluationRequest | FitRequest) -> float:
    return request.agent.step_cost if isinstance(request, EvaluationRequest) else 1.0


def _on_psi(request: EvaluationRequest | FitRequest) -> bool:
    return isinstance(request, EvaluationRequest) and request.sign == 0
