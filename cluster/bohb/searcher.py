"""The search as Ray Tune sees it: a `Searcher` under Tune's plain FIFO scheduler.

A Tune trial is one job (configuration, budget). A promoted configuration comes as
a new trial that continues from the checkpoint of its lower rung.
"""

import time
from typing import Any

from ray.tune.search import Searcher

from cluster.bohb.search import BracketSearch, Job

#: Keys of what a trial reports; the seconds are those of its job so far.
OBJECTIVE, BUDGET_REACHED, KERNEL_SECONDS = "objective", "budget_reached", "kernel_seconds"


class DriverOnly:
    """For what Ray Tune is given: Tune pickles it, to restore experiments from; here
    they are restored from the journal, so there is nothing to pickle."""

    def __getstate__(self) -> dict[str, Any]:
        return {}


class BohbSearcher(DriverOnly, Searcher):  # type: ignore[misc]
    """Hands out at most `concurrent` jobs at a time, none after `deadline`
    (seconds of `time.monotonic`); each has `workers_per_trial` cores."""

    def __init__(
        self,
        search: BracketSearch,
        concurrent: int,
        deadline: float,
        workers_per_trial: int = 1,
    ) -> None:
        super().__init__(metric=OBJECTIVE, mode="max")
        self._search = search
        self._concurrent = concurrent
        self._deadline = deadline
        self._workers_per_trial = workers_per_trial
        self._started: float | None = None  # monotonic, when the first job was handed out
        self._reported = 0.0  # likewise, when a trial last reported
        self._kernel_seconds: dict[str, float] = {}  # by trial
        self.jobs: dict[str, Job] = {}  # of the live trials

    @property
    def time_is_up(self) -> bool:
        """Whether the deadline has passed."""
        return time.monotonic() >= self._deadline

    @property
    def core_utilisation(self) -> float:
        """Share of the cores' time that was spent in evaluations, from the first job of
        this process to the last report of a trial."""
        if self._started is None or self._reported <= self._started:
            return 0.0
        cores = self._concurrent * self._workers_per_trial
        spent = sum(self._kernel_seconds.values())
        return spent / ((self._reported - self._started) * cores)

    def suggest(self, trial_id: str) -> dict[str, Any] | str | None:
        """The next job, None while there is nothing to start, FINISHED at the end."""
        if self.time_is_up or self._search.finished:
            return str(Searcher.FINISHED)
        if len(self.jobs) >= self._concurrent:
            return None
        job = self._search.next_job()
        if job is None:
            return None
        self.jobs[trial_id] = job
        self._started = self._started or time.monotonic()
        return {
            "job": {"id": list(job.id), "configuration": job.configuration, "budget": job.budget}
        }

    def on_trial_result(self, trial_id: str, result: dict[str, Any]) -> None:
        """Count what the trial's cores did. (Tune does not call this for a last result.)"""
        self._reported = time.monotonic()
        self._kernel_seconds[trial_id] = float(result.get(KERNEL_SECONDS, 0.0))

    def on_trial_complete(
        self, trial_id: str, result: dict[str, Any] | None = None, error: bool = False
    ) -> None:
        """Register the trial's result; one that was stopped short will run again."""
        job = self.jobs.pop(trial_id, None)
        if job is None:
            return
        if error or result is None:
            self._search.register(job, None, exception="the trial failed")
        elif result.get(BUDGET_REACHED):
            self.on_trial_result(trial_id, result)
            info = {"core_utilisation": round(self.core_utilisation, 4)}
            self._search.register(job, -float(result[OBJECTIVE]), info)
        else:
            self._search.put_back(job)

    def save(self, checkpoint_path: str) -> None:
        """Nothing: the journal is the search's state."""

    def restore(self, checkpoint_path: str) -> None:
        """Nothing: the journal is the search's state."""
