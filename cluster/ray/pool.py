"""A pool of Ray actors that evaluates SEs.

Requests are sent in batches as actors become free, the longest first (`cluster.ray.queue`), and
only to actors that have started: nodes may come and go. An actor that dies is replaced and its
requests are run again, with the same results, because a result depends on its request alone.
"""

from collections.abc import Callable, Sequence
from typing import Any, Self

import ray
from ray.exceptions import RayError, RayTaskError

from bilevel.errors import InvalidInput, first_line
from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource, evaluate
from bilevel.tasks import Task
from cluster.ray.connection import Capacity
from cluster.ray.queue import Batch, RequestQueue

#: Actor deaths on one batch after which the pool gives up: the cause is then a request (out of
#: memory, say) and not the machine. The same number, per actor, limits deaths in a row at start.
MAX_DEATHS = 5


class ActorsDied(InvalidInput):
    """Actors keep dying, so that the evaluations cannot be made here."""


class _Worker:
    """Actor that evaluates requests one after the other."""

    def arrive(self) -> None:
        """Return once the actor is up."""

    def evaluate(self, task: Task, se: SESource, batch: Batch) -> list[EvaluationResult]:
        return [evaluate(task, se, request) for request in batch.requests]


class EvaluationPool:
    """`workers` actors of one core each; a context manager that ends them.

    If fewer cores are free, the actors that got one do all the work.
    """

    def __init__(self, workers: int) -> None:
        self._actors = [_spawn() for _ in range(workers)]
        self._arriving = {actor.arrive.remote(): i for i, actor in enumerate(self._actors)}
        self._arrived: set[int] = set()
        self._deaths_on_arrival = 0
        #: Seconds that its actors have spent in evaluations.
        self.evaluation_seconds = 0.0
        #: Steps on the real task that its evaluations have made.
        self.real_env_steps = 0

    @classmethod
    def on_cluster(cls, workers: int | None) -> Self:
        """A pool of `workers` actors, or (None) one per core of this run's share of the cluster.

        Raises InvalidInput if the cluster has fewer cores. One that has none yet adds nodes for
        actors that wait, if it has an autoscaler.
        """
        capacity = Capacity.of_cluster()
        workers = workers or capacity.fair_share(1)
        if capacity.cores:
            capacity.require(workers)
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
        se: SESource,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> list[EvaluationResult]:
        """Evaluate all requests; return the results in no particular order.

        The SE or SEs, or the distribution that requests draw from, are sent once. `on_result` is
        called with each result. Raises ActorsDied if actors keep dying on one batch or at start,
        and Mistake for a wrong agent or task of a user's.
        """
        sent = [ray.put(task), ray.put(se)]
        waiting = RequestQueue(requests, self.size)
        held: list[list[Batch]] = [[] for _ in self._actors]  # oldest first
        running: dict[Any, tuple[int, Batch]] = {}  # by reference; of the actor with that number
        deaths: dict[int, int] = {}
        results: list[EvaluationResult] = []
        while waiting or running:
            for slot in sorted(self._arrived, key=lambda k: len(held[k])):  # idle ones first
                while (batch := waiting.take(held[slot])) is not None:
                    running[self._actors[slot].evaluate.remote(*sent, batch)] = slot, batch
                    held[slot].append(batch)
            (done,), _ = ray.wait([*running, *self._arriving], num_returns=1)
            if done in self._arriving:
                self._receive(done)
                continue
            slot, batch = running.pop(done)
            try:
                answers = ray.get(done)
            except RayTaskError as error:
                if isinstance(error.cause, InvalidInput):  # a user's agent or task is wrong
                    raise error.cause from None
                raise
            except (
                RayError
            ) as error:  # actor, node or object was lost: its requests can be run again
                fatal = held[slot][0].index
                deaths[fatal] = deaths.get(fatal, 0) + 1
                if deaths[fatal] >= MAX_DEATHS:
                    agents = {request.agent.agent for request in held[slot][0].requests}
                    raise ActorsDied(
                        f"{MAX_DEATHS} actors died in the same evaluations, of the agent "
                        f"{' or '.join(sorted(agents))}: it ends its process, or needs more memory "
                        f"than there is ({first_line(error)})"
                    ) from error
                self._replace(slot)
                running = {other: one for other, one in running.items() if one[0] != slot}
                waiting.put_back(held[slot])
                held[slot] = []
                continue
            held[slot].remove(batch)
            for result in answers:
                self.evaluation_seconds += result.seconds
                self.real_env_steps += result.real_env_steps
                results.append(result)
                on_result(result)
        return results

    def _receive(self, reference: Any) -> None:
        """Register an actor that has started, or replace one that died at start."""
        slot = self._arriving.pop(reference)
        try:
            ray.get(reference)
        except RayError as error:
            self._deaths_on_arrival += 1
            if self._deaths_on_arrival >= MAX_DEATHS * self.size:
                raise ActorsDied(f"no actor arrives: {first_line(error)}") from error
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
