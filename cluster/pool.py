"""A pool of Ray actors that answers evaluation requests.

Requests are handed out as actors become free, the longest first (`request_queue`). An
actor that dies is replaced and what it held is run again, which changes nothing: an
evaluation depends on its request alone.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self

import numpy as np
import ray
from numpy.typing import NDArray
from ray.exceptions import RayActorError
from ray.util.placement_group import placement_group, remove_placement_group
from ray.util.scheduling_strategies import PlacementGroupSchedulingStrategy

from bilevel.evaluation import EvaluationRequest, EvaluationResult, evaluate
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task
from cluster.request_queue import RequestQueue

#: Deaths of actors on one and the same request after which it is given up: then it
#: is the request (out of memory, say) and not the machine.
MAX_DEATHS = 5


class _Worker:
    """Evaluates one request after the other."""

    def evaluate(
        self,
        task: Task,
        architecture: Architecture | None,
        psi: NDArray[np.float32] | None,
        request: EvaluationRequest,
    ) -> EvaluationResult:
        return evaluate(task, architecture, psi, request)


class EvaluationPool:
    """`workers` actors of one core each; a context manager that ends them.

    `options` go to Ray with each actor (its scheduling strategy, for instance).
    """

    def __init__(self, workers: int, **options: Any) -> None:
        self._options = {"num_cpus": 1, **options}
        self._actors = [self._spawn() for _ in range(workers)]
        #: Seconds its actors have spent in evaluations.
        self.kernel_seconds = 0.0

    @property
    def size(self) -> int:
        """Number of actors."""
        return len(self._actors)

    def _spawn(self) -> Any:
        return ray.remote(_Worker).options(**self._options).remote()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """End all actors."""
        for actor in self._actors:
            ray.kill(actor)
        self._actors = []

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
        for result in self._results(task, architecture, psi, requests):
            self.kernel_seconds += result.seconds
            results.append(result)
            on_result(result)
        return results

    def _results(
        self,
        task: Task,
        architecture: Architecture | None,
        psi: NDArray[np.float32] | None,
        requests: Sequence[EvaluationRequest],
    ) -> Iterator[EvaluationResult]:
        shared = [ray.put(item) for item in (task, architecture, psi)]
        waiting = RequestQueue(requests, self.size)
        held: list[list[EvaluationRequest]] = [[] for _ in self._actors]  # oldest first
        running: dict[Any, int] = {}  # reference -> actor
        deaths: dict[int, int] = {}
        while waiting or running:
            for slot in sorted(range(self.size), key=lambda k: len(held[k])):  # idle ones first
                while (request := waiting.take(held[slot])) is not None:
                    running[self._actors[slot].evaluate.remote(*shared, request)] = slot
                    held[slot].append(request)
            (done,), _ = ray.wait(list(running), num_returns=1)
            slot = running.pop(done)
            try:
                result = ray.get(done)
            except RayActorError as error:
                fatal = held[slot][0].index
                deaths[fatal] = deaths.get(fatal, 0) + 1
                if deaths[fatal] >= MAX_DEATHS:
                    raise RuntimeError(
                        f"{MAX_DEATHS} actors died on evaluation {fatal}: {error}"
                    ) from error
                ray.kill(self._actors[slot])
                self._actors[slot] = self._spawn()
                running = {other: k for other, k in running.items() if k != slot}
                waiting.put_back(held[slot])
                held[slot] = []
            else:
                held[slot].pop(0)
                yield result


@contextmanager
def placed_pool(workers: int) -> Iterator[EvaluationPool]:
    """A pool in a placement group of its own; both are gone afterwards."""
    group = placement_group([{"CPU": 1}] * workers, strategy="PACK")
    try:
        strategy = PlacementGroupSchedulingStrategy(group)
        with EvaluationPool(workers, scheduling_strategy=strategy) as pool:
            yield pool
    finally:
        remove_placement_group(group)
