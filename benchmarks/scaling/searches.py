"""Scenarios of a whole search: the `paper` profile on clusters, split into trials."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.scaling.evaluations import processes
from benchmarks.scaling.generations import CORES, GENERATION
from benchmarks.scaling.recorded import RecordedRun
from benchmarks.scaling.simulation import (
    JobCourse,
    PoolOverhead,
    SearchTimeline,
    StudyOverhead,
    simulate_pool,
    simulate_search,
)
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import get_task
from cluster.bohb.brackets import Schedule
from cluster.bohb.journal import ConfigId, Journal
from cluster.bohb.search import BracketSearch, Job
from cluster.bohb.searcher import BohbSearcher
from cluster.profiles import Profile, base_hyperparameters, get_profile
from search_spaces import search_space, to_hyperparameters

WORKERS = (1, 2, 4, 8, 16, 24, GENERATION)

#: Longer searches on the largest cluster: so many times the profile's brackets.
TIMES_BRACKETS = (2, 4)


@dataclass
class Courses:
    """How long the jobs of a search take.

    A configuration is given the level of one that was measured (its mean seconds of an
    evaluation on an untrained SE). Its evaluations spread around that level, and the
    level changes over the generations, as in the recorded run. All of it depends on
    configuration and generation alone, so that every split has the same work to do.
    """

    run: RecordedRun
    levels: Sequence[float]
    base: Hyperparameters
    workers: int
    overhead: PoolOverhead
    reached: dict[ConfigId, int] = field(default_factory=dict)

    def __call__(self, job: Job) -> JobCourse:
        """The generations that this job has left to run."""
        done = self.reached.get(job.id, 0)
        self.reached[job.id] = job.budget
        quality = np.random.default_rng([*job.id]).normal()
        level = float(np.random.default_rng([*job.id, 1]).choice(self.levels))
        count = to_hyperparameters(self.base, job.configuration).nes.evaluations
        seconds, busy = [], []
        for generation in range(done, job.budget):
            evaluations = level * self._shape(job.id, generation, count)
            line = simulate_pool(evaluations.tolist(), self.workers, self.overhead)
            seconds.append(line.seconds + self.run.between)
            busy.append(line.busy)
        return JobCourse(seconds, busy, loss=-quality - 0.01 * job.budget)

    def _shape(self, config_id: ConfigId, generation: int, count: int) -> NDArray[np.float64]:
        first = self.run.generations[0].seconds.mean()
        recorded = self.run.generations[min(generation, len(self.run.generations) - 1)]
        generator = np.random.default_rng([*config_id, 2, generation])
        drawn: NDArray[np.float64] = generator.choice(recorded.seconds, count) / first
        return drawn


def simulated(
    profile: Profile,
    trials: int,
    cores: int,
    courses: Callable[[Job], JobCourse],
    overhead: StudyOverhead,
    seed: int = 0,
) -> SearchTimeline:
    """A search of that profile, `trials` at a time."""
    schedule = Schedule.of("bohb", profile.smallest_budget, profile.largest_budget, profile.cycle)
    with tempfile.TemporaryDirectory() as folder:
        space = search_space(profile.space)
        search = BracketSearch(space, schedule, profile.brackets, seed, Journal(Path(folder)))
        return simulate_search(
            BohbSearcher(search, lambda: trials, float("inf")), cores, courses, overhead
        )


@dataclass(frozen=True)
class Splits:
    """The `paper` profile on a cluster; called with its cores, the workers per trial, and
    how many times as many brackets as the profile has."""

    run: RecordedRun
    levels: Sequence[float]
    pool: PoolOverhead
    study: StudyOverhead

    def __call__(self, scenario: tuple[int, int, int]) -> dict[str, float]:
        cores, workers, times = scenario
        profile = get_profile("paper")
        profile = replace(profile, brackets=times * profile.brackets)
        base = base_hyperparameters(profile, get_task(self.run.task))
        courses = Courses(self.run, self.levels, base, workers, self.pool)
        line = simulated(profile, cores // workers, cores, courses, self.study)
        return {
            "cores": cores,
            "workers_per_trial": workers,
            "trials": cores // workers,
            "brackets": profile.brackets,
            "hours": round(line.seconds / 3600, 3),
            "efficiency": round(line.efficiency, 4),
            "model_based": round(line.model_based, 4),
            "driver_share": round(line.driver / line.seconds, 4),
        }

    def all(self) -> list[dict[str, float]]:
        """On all clusters. BOHB's proposals, the real ones, take minutes in all."""
        scenarios = [(c, w, 1) for c in CORES for w in WORKERS if w <= c]
        with processes() as workers:
            return list(workers.executor.map(self, scenarios))

    def longer(self) -> list[dict[str, float]]:
        """Searches of more brackets."""
        scenarios = [(CORES[-1], WORKERS[-1], times) for times in TIMES_BRACKETS]
        with processes() as workers:
            return list(workers.executor.map(self, scenarios))
