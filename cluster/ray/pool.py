"""A pool of Ray actors that evaluates SEs.

Each actor gets batches of requests, the most expensive first, once it has started: nodes may join
and leave. The pool replaces an actor that dies and resubmits its requests to any actor. The results
stay the same, because a result depends only on its request.
"""

from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any, Self

import ray
from ray.exceptions import RayError, RayTaskError

from bilevel.errors import InvalidInput, first_line
from bilevel.evaluation import Centre, EvaluationRequest, EvaluationResult, SESource, evaluate
from bilevel.tasks import Task
from cluster.ray.connection import cluster_cores

#: Requests that an actor evaluates in one call.
Batch = tuple[EvaluationRequest, ...]

#: A batch is 1 / BATCHES of an actor's share of the remaining requests (guided self-scheduling;
#: Polychronopoulos and Kuck, 1987): first large, because a round trip takes about a millisecond and
#: an evaluation may take five, and at last single, so that actors finish at about the same time.
BATCHES = 4

#: Expected cost, in multiplications per training step, above which a batch takes no more requests,
#: so that little is lost if the driver ends. Eight small agents, about half a second, reach it.
LONG = 2e6

#: Deaths of actors in the same batch after which the pool gives up, because a request must be the
#: cause (out of memory, for instance). Also the limit, per actor, of deaths in a row at start.
MAX_DEATHS = 5


class ActorsDied(InvalidInput):
    """Actors keep dying, so that evaluations cannot finish."""


class NoActorStarts(ActorsDied):
    """The cluster or a node is broken; no evaluation is the cause."""


class _Worker:
    """Actor that evaluates requests one after the other."""

    def evaluate(self, task: Task, se: SESource, batch: Batch) -> list[EvaluationResult]:
        return [evaluate(task, se, request) for request in batch]


class EvaluationPool:
    """A pool of `workers` actors with one core each, by default one per core of the cluster. Those
    with a core do all the work."""

    def __init__(self, workers: int | None = None) -> None:
        #: Number of actors.
        self.size = cluster_cores() if workers is None else workers
        self._started: list[Any] = []
        self._starting: dict[Any, Any] = {}  # actors by a reference that is ready once they start
        self._deaths_at_start = 0
        for _ in range(self.size):
            self._start_actor()
        #: Steps on the real task that the evaluations have made.
        self.real_env_steps = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """End all actors."""
        for actor in [*self._started, *self._starting.values()]:
            ray.kill(actor)
        self._started, self._starting = [], {}

    def run(
        self,
        task: Task,
        se: SESource,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> list[EvaluationResult]:
        """Evaluate all requests and return the results in no particular order.

        `se` (an SE, several SEs, or a distribution that requests draw from) is sent once. Raises
        ActorsDied if actors keep dying, and UserCodeError for an error in a custom agent or task.
        """
        arguments = [ray.put(task), ray.put(se)]
        waiting = deque(batches(requests, self.size))
        running: dict[Any, tuple[Any, Batch]] = {}  # actor and batch by reference
        deaths: Counter[int] = Counter()  # by the index of a batch's first request
        results: list[EvaluationResult] = []
        while waiting or running:
            busy = {actor for actor, _ in running.values()}
            for actor in [actor for actor in self._started if actor not in busy]:
                if waiting:
                    batch = waiting.popleft()
                    running[actor.evaluate.remote(*arguments, batch)] = actor, batch
            (finished,), _ = ray.wait([*running, *self._starting], num_returns=1)
            if finished in self._starting:
                self._register_start(finished)
                continue
            actor, batch = running.pop(finished)
            try:
                answers: list[EvaluationResult] = ray.get(finished)
            except RayTaskError as error:  # an error of the evaluation itself
                raise (error.cause if isinstance(error.cause, InvalidInput) else error) from None
            except RayError as error:  # the actor, its node or the result was lost
                _count_death(batch, deaths, error)
                waiting.appendleft(batch)
                self._replace(actor)
                continue
            for result in answers:
                self.real_env_steps += result.real_env_steps
                results.append(result)
                on_result(result)
        return results

    def _start_actor(self) -> None:
        actor = ray.remote(_Worker).options(num_cpus=1).remote()
        self._starting[actor.__ray_ready__.remote()] = actor

    def _register_start(self, reference: Any) -> None:
        """Register an actor that has started, or replace an actor that died at start."""
        actor = self._starting.pop(reference)
        try:
            ray.get(reference)
        except RayError as error:
            self._replace(actor)
            self._deaths_at_start += 1
            if self._deaths_at_start >= MAX_DEATHS * self.size:
                self._deaths_at_start = 0
                raise NoActorStarts(f"no actor can start: {first_line(error)}") from error
        else:
            self._deaths_at_start = 0
            self._started.append(actor)

    def _replace(self, actor: Any) -> None:
        ray.kill(actor)
        self._started = [other for other in self._started if other != actor]
        self._start_actor()


def _count_death(batch: Batch, deaths: Counter[int], error: RayError) -> None:
    """Count the death of an actor in `batch`. Raises ActorsDied at the limit."""
    deaths[batch[0].index] += 1
    if deaths[batch[0].index] >= MAX_DEATHS:
        agents = sorted({request.agent.agent for request in batch})
        raise ActorsDied(
            f"{MAX_DEATHS} actors died in evaluations of {' or '.join(agents)}: it ends its "
            f"process, or needs more memory than is available ({first_line(error)})"
        ) from error


def batches(requests: Sequence[EvaluationRequest], actors: int) -> list[Batch]:
    """Return all requests in batches of decreasing cost, the most expensive requests first.

    Longest processing time first avoids that an actor starts a long evaluation at the end (Graham,
    1969). Agents on the unperturbed SE come last because they tend to stop sooner.
    """
    ordered = sorted(
        requests, key=lambda request: (-request.agent.step_cost, isinstance(request.on, Centre))
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
