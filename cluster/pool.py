"""A pool of Ray actors that evaluates SEs, and fits them.

Requests are handed out as actors become free, the longest first (`request_queue`), and
only to actors that have arrived: nodes may come and go. An actor that dies is replaced
and what it held is run again, which changes nothing: an answer depends on its request alone.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Self

import numpy as np
import ray
from numpy.typing import NDArray
from ray.exceptions import RayError, RayTaskError

from bilevel.evaluation import EvaluationRequest, EvaluationResult, evaluate
from bilevel.nes import Psi
from bilevel.synthetic_env import Architecture
from bilevel.synthetic_env.fitted import fitted_psi
from bilevel.tasks import Task
from cluster.ray_cluster import fair_share, require_capacity
from cluster.request_queue import FitRequest, Request, RequestQueue

#: Deaths of actors on one and the same request after which it is given up: then it
#: is the request (out of memory, say) and not the machine. Likewise deaths in a row of
#: actors that have not even arrived.
MAX_DEATHS = 5


class _Worker:
    """Answers one request after the other."""

    def arrive(self) -> None:
        """Returns once the actor is up."""

    def evaluate(
        self,
        task: Task,
        architecture: Architecture | None,
        psi: NDArray[np.float32] | None,
        request: EvaluationRequest,
    ) -> EvaluationResult:
        return evaluate(task, architecture, psi, request)

    def fit(self, task: Task, architecture: Architecture, request: FitRequest) -> Psi:
        return fitted_psi(task, architecture, request.seed)


class EvaluationPool:
    """`workers` actors of one core each; a context manager that ends them.

    With fewer cores free, the actors that find one do all the work.
    """

    def __init__(self, workers: int) -> None:
        self._actors = [_spawn() for _ in range(workers)]
        self._arriving = {actor.arrive.remote(): i for i, actor in enumerate(self._actors)}
        self._arrived: set[int] = set()
        self._deaths_on_arrival = 0
        #: Seconds its actors have spent in evaluations.
        self.kernel_seconds = 0.0

    @classmethod
    def on_cluster(cls, workers: int | None) -> Self:
        """A pool of that many actors, or of one a core of this run's share of the cluster.

        Raises InvalidInput if the cluster has fewer cores.
        """
        workers = workers or fair_share(1)
        require_capacity(workers)
        return cls(workers)

    @property
    def size(self) -> int:
        """Number of actors."""
        return len(self._actors)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """End all actors."""
        for actor in self._actors:
            ray.kill(actor)
        self._actors, self._arriving, self._arrived = [], {}, set()

    def run(
        self,
        task: Task,
        architecture: Architecture | None,
        psi: NDArray[np.float32] | None,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> list[EvaluationResult]:
        """Answers to all requests, in no particular order; psi (P,) is sent once.

        Raises RuntimeError if actors keep dying on one request.
        """
        results = []
        for _, result in self._answers("evaluate", (task, architecture, psi), requests):
            self.kernel_seconds += result.seconds
            results.append(result)
            on_result(result)
        return results

    def fits(
        self,
        task: Task,
        architecture: Architecture,
        seeds: Sequence[int],
        on_fit: Callable[[], None] = lambda: None,
    ) -> list[Psi]:
        """psi (P,) of the SEs fitted to the task by these seeds, in their order.

        Raises RuntimeError if actors keep dying on one of them.
        """
        requests = [FitRequest(index, seed) for index, seed in enumerate(seeds)]
        fitted: dict[int, Psi] = {}
        for request, psi in self._answers("fit", (task, architecture), requests):
            fitted[request.index] = np.array(psi)  # Ray's own must not be written to
            on_fit()
        return [fitted[index] for index in range(len(requests))]

    def _answers(
        self, method: str, shared: Sequence[Any], requests: Sequence[Request]
    ) -> Iterator[tuple[Request, Any]]:
        """Every request with what an actor's method returns for it; what they share is sent
        once."""
        sent = [ray.put(item) for item in shared]
        waiting = RequestQueue(requests, self.size)
        held: list[list[Request]] = [[] for _ in self._actors]  # oldest first
        running: dict[Any, int] = {}  # reference -> actor
        deaths: dict[int, int] = {}
        while waiting or running:
            for slot in sorted(self._arrived, key=lambda k: len(held[k])):  # idle ones first
                while (request := waiting.take(held[slot])) is not None:
                    ask = getattr(self._actors[slot], method)
                    running[ask.remote(*sent, request)] = slot
                    held[slot].append(request)
            (done,), _ = ray.wait([*running, *self._arriving], num_returns=1)
            if done in self._arriving:
                self._receive(done)
                continue
            slot = running.pop(done)
            try:
                answer = ray.get(done)
            except RayTaskError:
                raise
            except RayError as error:  # of actor, node or object: the request is unharmed
                fatal = held[slot][0].index
                deaths[fatal] = deaths.get(fatal, 0) + 1
                if deaths[fatal] >= MAX_DEATHS:
                    raise RuntimeError(
                        f"{MAX_DEATHS} actors died on request {fatal}: {error}"
                    ) from error
                self._replace(slot)
                running = {other: k for other, k in running.items() if k != slot}
                waiting.put_back(held[slot])
                held[slot] = []
            else:
                yield held[slot].pop(0), answer

    def _receive(self, reference: Any) -> None:
        """An actor has arrived, or died on the way and is replaced."""
        slot = self._arriving.pop(reference)
        try:
            ray.get(reference)
        except RayError as error:
            self._deaths_on_arrival += 1
            if self._deaths_on_arrival >= MAX_DEATHS * self.size:
                raise RuntimeError(f"no actor arrives: {error}") from error
            self._replace(slot)
        else:
            self._deaths_on_arrival = 0
            self._arrived.add(slot)

    def _replace(self, slot: int) -> None:
        ray.kill(self._actors[slot])
        self._arrived.discard(slot)
        self._actors[slot] = _spawn()
        self._arriving[self._actors[slot].arrive.remote()] = slot


def _spawn() -> Any:
    return ray.remote(_Worker).options(num_cpus=1).remote()
