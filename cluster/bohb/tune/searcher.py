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
from bilevel.user_code import Mistake
from cluster.bohb.search.bracket_search import BracketSearch, Job
from cluster.bohb.study.journal import ConfigId
from cluster.bohb.tune.trial import (
    BUDGET_REACHED,
    EVALUATION_SECONDS,
    FAILURE,
    JOB,
    MISTAKE,
    NO_STORAGE,
    OBJECTIVE,
    TALLY,
)

#: Deaths of trial processes on one job after which the configuration counts as failed.
DEATHS = 20


class DriverOnly:
    """Base of objects passed to Ray Tune that must not be pickled.

    Tune pickles them to restore experiments; studies are restored from their journal instead.
    """

    def __getstate__(self) -> dict[str, Any]:
        return {}


class BohbSearcher(DriverOnly, Searcher):  # type: ignore[misc]
    """Hands out at most `concurrent()` jobs at a time, each with `workers_per_trial` cores.

    It hands out no job after `deadline` (seconds of `time.monotonic`), nor once an error is
    stored in `stopped_by`.
    """

    def __init__(
        self,
        search: BracketSearch,
        concurrent: Callable[[], int],
        deadline: float,
        workers_per_trial: int = 1,
    ) -> None:
        super().__init__(metric=OBJECTIVE, mode="min")
        self._search = search
        self._concurrent = concurrent
        self._slots = 0  # last value of `concurrent()`
        self._deadline = deadline
        self._workers_per_trial = workers_per_trial
        self._reported: float | None = (
            None  # monotonic time of the last report of a trial (or first job)
        )
        self._core_seconds = 0.0  # available core time until then
        self._evaluation_seconds: dict[str, float] = {}  # spent in evaluations, by trial
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
        return sum(self._evaluation_seconds.values()) / self._core_seconds

    def suggest(self, trial_id: str) -> dict[str, Any] | str | None:
        """The next job; None while no job can start; FINISHED at the end."""
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
        return {JOB: {"id": list(job.id), "configuration": job.configuration, "budget": job.budget}}

    def on_trial_result(self, trial_id: str, result: dict[str, Any]) -> None:
        """Add up core and evaluation time. (Tune does not call this for a trial's last result.)"""
        now = time.monotonic()
        cores = self._slots * self._workers_per_trial
        self._core_seconds += (now - (self._reported or now)) * cores
        self._reported = now
        self._evaluation_seconds[trial_id] = float(result.get(EVALUATION_SECONDS, 0.0))

    def on_trial_complete(
        self, trial_id: str, result: dict[str, Any] | None = None, error: bool = False
    ) -> None:
        """Register the trial's result.

        A job that was interrupted, or whose process died, is handed out again and resumes from
        its checkpoint. Errors go to `stopped_by`: Tune would take a raised one for the trial's.
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
        if error:  # the trial's process or node died, or the actor it was to reuse
            key = job.id, job.budget
            self._deaths[key] = self._deaths.get(key, 0) + 1
            if self._deaths[key] < DEATHS:
                self._search.put_back(job)
            else:
                text = f"the trial's process died {DEATHS} times"
                self._search.register(job, None, exception=text)
        elif NO_STORAGE in result:
            raise StorageFailure(str(result[NO_STORAGE]))
        elif MISTAKE in result and not self._search.succeeded:
            raise Mistake(str(result[MISTAKE]))
        elif MISTAKE in result:  # with other hyperparameters the agent works
            self._search.register(job, None, exception=str(result[MISTAKE]))
        elif FAILURE in result:
            self._search.register(job, None, exception=str(result[FAILURE]))
        elif not result.get(BUDGET_REACHED):
            self._search.put_back(job)
        elif math.isfinite(objective := float(result[OBJECTIVE])):
            info = {**result[TALLY].info, "core_utilisation": round(self.core_utilisation, 4)}
            self._search.register(job, objective, info)
        else:
            self._search.register(job, None, exception=f"the objective is {objective}")

    def save(self, checkpoint_path: str) -> None:
        """Do nothing: the journal is the search's state."""

    def restore(self, checkpoint_path: str) -> None:
        """Do nothing: the journal is the search's state."""
