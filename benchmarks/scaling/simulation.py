"""One generation on the actor pool, and a whole search, in simulated time.

symbol   meaning
------   ---------------------------------------------------------------------
c        cores, one actor on each
n        evaluations that may run at the same time (48 in a generation of 16)
t_i      seconds of evaluation i on its core

The pool sends a request to whichever actor is idle, in the order of the requests: list
scheduling. Its driver sends and receives alone, one evaluation after the other; a
message costs its actor the rest of the overhead. Nothing is known of evaluations but
how long they take.
"""

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cluster.bohb.search import Job
from cluster.bohb.searcher import BohbSearcher
from cluster.bohb.trial import BUDGET_REACHED, OBJECTIVE


@dataclass(frozen=True)
class PoolOverhead:
    """Seconds per evaluation: of the driver, and of the actor besides."""

    driver: float = 0.0
    actor: float = 0.0


@dataclass(frozen=True)
class Timeline:
    """What became of c cores and n evaluations."""

    cores: int
    evaluations: int
    seconds: float  # from the first request to the last answer (the makespan)
    busy: float  # sum of t_i

    @property
    def efficiency(self) -> float:
        """Share of all cores' time spent in evaluations."""
        return self.busy / (self.cores * self.seconds)

    @property
    def straggler_share(self) -> float:
        """Share of the time of those cores that had work in which they had none left
        and waited for the slowest evaluation (overheads, small, count as waiting)."""
        return 1.0 - self.busy / (min(self.cores, self.evaluations) * self.seconds)


def simulate_pool(
    seconds: Sequence[float], cores: int, overhead: PoolOverhead | None = None
) -> Timeline:
    """Evaluations (n,) of the given seconds, in the order of the requests, on `cores`."""
    costs = overhead or PoolOverhead()
    idle_from = [0.0] * min(cores, len(seconds))  # a heap: when each actor is idle next
    driver_from = 0.0
    for duration in seconds:
        sent = max(idle_from[0], driver_from) + costs.driver
        driver_from = sent
        heapq.heapreplace(idle_from, sent + costs.actor + duration)
    return Timeline(cores, len(seconds), max(idle_from), sum(seconds))


@dataclass(frozen=True)
class StudyOverhead:
    """Seconds of the search's driver: per job it starts and ends, per generation that is
    reported to it; and, once, until the first pool is up. It does one thing at a time,
    and a trial waits for it."""

    job: float = 0.0
    report: float = 0.0
    start: float = 0.0


@dataclass(frozen=True)
class JobCourse:
    """A job as the search's simulation knows it: the seconds of each generation that is
    left to run (wall-clock and, summed over its workers, in evaluations), its loss."""

    seconds: Sequence[float]
    busy: Sequence[float]
    loss: float


@dataclass(frozen=True)
class SearchTimeline:
    """What became of a search."""

    cores: int
    seconds: float
    busy: float
    driver: float  # seconds the search's driver was busy
    jobs: tuple[Job, ...]  # in the order of their starts

    @property
    def efficiency(self) -> float:
        """Share of all cores' time spent in evaluations."""
        return self.busy / (self.cores * self.seconds)

    @property
    def model_based(self) -> float:
        """Share of the configurations that BOHB's model proposed."""
        picks = {job.id: job.model_based for job in self.jobs}
        return sum(picks.values()) / len(picks)


def simulate_search(
    searcher: BohbSearcher,
    cores: int,
    course: Callable[[Job], JobCourse],
    overhead: StudyOverhead | None = None,
) -> SearchTimeline:
    """The product's own searcher, asked and told as Ray Tune asks and tells it, each
    result at its simulated time."""
    costs = overhead or StudyOverhead()
    events: list[tuple[float, int, int]] = []  # a generation is over: (when, trial, which)
    courses: dict[int, JobCourse] = {}
    jobs: list[Job] = []
    driver_from, driver_busy, busy, now = costs.start, 0.0, 0.0, 0.0
    while True:
        while isinstance(searcher.suggest(str(len(jobs))), dict):
            trial = len(jobs)
            jobs.append(searcher.jobs[str(trial)])
            courses[trial] = course(jobs[trial])
            driver_from = max(driver_from, now) + costs.job
            driver_busy += costs.job
            heapq.heappush(events, (driver_from + courses[trial].seconds[0], trial, 0))
        if not events:
            return SearchTimeline(cores, driver_from, busy, driver_busy, tuple(jobs))
        now, trial, generation = heapq.heappop(events)
        driver_from = max(driver_from, now) + costs.report
        driver_busy += costs.report
        job = courses[trial]
        busy += job.busy[generation]
        if generation + 1 < len(job.seconds):
            following = driver_from + job.seconds[generation + 1]
            heapq.heappush(events, (following, trial, generation + 1))
        else:
            result = {OBJECTIVE: -job.loss, BUDGET_REACHED: True}
            searcher.on_trial_complete(str(trial), result)
