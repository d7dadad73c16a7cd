"""The search as Ray Tune sees it: a `Searcher` under Tune's plain FIFO scheduler.

A Tune trial is one job (configuration, budget). A promoted configuration comes as
a new trial that continues from the checkpoint of its lower rung.
"""

import math
import time
from collections.abc import Callable
from typing import Any

from ray.tune.search import Searcher

from bilevel.errors import InvalidInput, StorageFailure
from cluster.bohb.journal import ConfigId
from cluster.bohb.search import BracketSearch, Job
from cluster.bohb.trial import BUDGET_REACHED, FAILURE, KERNEL_SECONDS, NO_STORAGE, OBJECTIVE

#: How often the process of one job's trial may die until the configuration has failed.
DEATHS = 20


class DriverOnly:
    """For what Ray Tune is given: Tune pickles it, to restore experiments from; here
    they are restored from the journal, so there is nothing to pickle."""

    def __getstate__(self) -> dict[str, Any]:
        return {}


class BohbSearcher(DriverOnly, Searcher):  # type: ignore[misc]
    """Hands out at most `concurrent()` jobs at a time, none after `deadline`
    (seconds of `time.monotonic`), and none once `stopped_by` says why; each has
    `workers_per_trial` cores."""

    def __init__(
        self,
        search: BracketSearch,
        concurrent: Callable[[], int],
        deadline: float,
        workers_per_trial: int = 1,
    ) -> None:
        super().__init__(metric=OBJECTIVE, mode="max")
        self._search = search
        self._concurrent = concurrent
        self._slots = 0  # what it said last
        self._deadline = deadline
        self._workers_per_trial = workers_per_trial
        self._reported: float | None = None  # monotonic, when a trial last did (or began)
        self._core_seconds = 0.0  # of all trials' cores, until then
        self._kernel_seconds: dict[str, float] = {}  # in evaluations, by trial
        self.jobs: dict[str, Job] = {}  # of the live trials
        self._deaths: dict[tuple[ConfigId, int], int] = {}  # by job
        self.stopped_by: InvalidInput | None = None

    @property
    def time_is_up(self) -> bool:
        """Whether the deadline has passed."""
        return time.monotonic() >= self._deadline

    @property
    def core_utilisation(self) -> float:
        """Share of the cores' time that was spent in evaluations, from the first job of
        this process to the last report of a trial."""
        if self._core_seconds == 0:
            return 0.0
        return sum(self._kernel_seconds.values()) / self._core_seconds

    def suggest(self, trial_id: str) -> dict[str, Any] | str | None:
        """The next job, None while there is nothing to start, FINISHED at the end."""
        if self.time_is_up or self.stopped_by is not None or self._search.finished:
            return str(Searcher.FINISHED)
        try:
            self._slots = self._concurrent()
            if len(self.jobs) >= self._slots:
                return None
            job = self._search.next_job()
        except InvalidInput as error:
            self.stopped_by = error
            return None
        if job is None:
            return None
        self.jobs[trial_id] = job
        self._reported = self._reported or time.monotonic()
        return {
            "job": {"id": list(job.id), "configuration": job.configuration, "budget": job.budget}
        }

    def on_trial_result(self, trial_id: str, result: dict[str, Any]) -> None:
        """Count what the trial's cores did. (Tune does not call this for a last result.)"""
        now = time.monotonic()
        cores = self._slots * self._workers_per_trial
        self._core_seconds += (now - (self._reported or now)) * cores
        self._reported = now
        self._kernel_seconds[trial_id] = float(result.get(KERNEL_SECONDS, 0.0))

    def on_trial_complete(
        self, trial_id: str, result: dict[str, Any] | None = None, error: bool = False
    ) -> None:
        """Register the trial's result; a job that was stopped short, or whose process
        died, is handed out again, and goes on from its checkpoint.

        Nothing is raised: Tune would take it for an error of the trial.
        """
        job = self.jobs.pop(trial_id, None)
        if job is None:
            return
        try:
            if result is not None:
                self.on_trial_result(trial_id, result)
            self._register(job, result or {}, error)
        except InvalidInput as reason:
            self.stopped_by = reason
            self._search.put_back(job)

    def _register(self, job: Job, result: dict[str, Any], error: bool) -> None:
        if error:  # of the trial's process or node, or of one that it was to take over
            key = job.id, job.budget
            self._deaths[key] = self._deaths.get(key, 0) + 1
            if self._deaths[key] < DEATHS:
                self._search.put_back(job)
            else:
                text = f"the trial's process died {DEATHS} times"
                self._search.register(job, None, exception=text)
        elif NO_STORAGE in result:
            raise StorageFailure(str(result[NO_STORAGE]))
        elif FAILURE in result:
            self._search.register(job, None, exception=str(result[FAILURE]))
        elif not result.get(BUDGET_REACHED):
            self._search.put_back(job)
        elif math.isfinite(objective := float(result[OBJECTIVE])):
            info = {"core_utilisation": round(self.core_utilisation, 4)}
            self._search.register(job, -objective, info)
        else:
            self._search.register(job, None, exception=f"the objective is {objective}")

    def save(self, checkpoint_path: str) -> None:
        """Nothing: the journal is the search's state."""

    def restore(self, checkpoint_path: str) -> None:
        """Nothing: the journal is the search's state."""
