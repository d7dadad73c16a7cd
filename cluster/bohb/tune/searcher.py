"""The search as Ray Tune sees it: a `Searcher` under Tune's FIFO scheduler.

A Tune trial is one job (configuration, budget). A promoted configuration is a new trial that
continues from the checkpoints of its lower rung.
"""

import math
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from ray.tune.search import Searcher

from bilevel.errors import InvalidInput, StorageFailure
from bilevel.user_code import UserCodeError
from cluster.bohb.search.bracket_search import BracketSearch, Job
from cluster.bohb.study.journal import ConfigId
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.trial import JOB, REPORT, TrialReport

#: Crashes of a job's process or node after which the configuration counts as failed.
MAX_CRASHES = 20


class DriverOnly:
    """Base of objects that Ray Tune must not pickle. Tune pickles them to restore experiments;
    studies are restored from their journal instead."""

    def __getstate__(self) -> dict[str, Any]:
        return {}


class BohbSearcher(DriverOnly, Searcher):  # type: ignore[misc]
    """Suggests at most `concurrent()` jobs at a time, none after `deadline` (seconds of
    `time.monotonic`), and none after an error, which is stored in `stopped_by`."""

    def __init__(
        self,
        search: BracketSearch,
        concurrent: Callable[[], int],
        deadline: float,
        report: StudyReport,
    ) -> None:
        super().__init__()
        self._search = search
        self._concurrent = concurrent
        self._deadline = deadline
        self._report = report
        self.jobs: dict[str, Job] = {}  # of the live trials
        self._crashes: Counter[tuple[ConfigId, int]] = Counter()  # by job
        self.stopped_by: InvalidInput | None = None

    @property
    def time_is_up(self) -> bool:
        """True after the deadline."""
        return time.monotonic() >= self._deadline

    def suggest(self, trial_id: str) -> dict[str, Any] | str | None:
        """Return the next job, None while no job can start, or FINISHED."""
        if self.time_is_up or self.stopped_by is not None or self._search.finished:
            return str(Searcher.FINISHED)
        try:
            job = self._search.next_job() if len(self.jobs) < self._concurrent() else None
        except InvalidInput as error:
            self.stopped_by = error
            return None
        if job is None:
            return None
        self.jobs[trial_id] = job
        self._report.started(job)
        return {JOB: {"id": list(job.id), "configuration": job.configuration, "budget": job.budget}}

    def on_trial_result(self, trial_id: str, result: dict[str, Any]) -> None:
        """Report a step after which the trial continues."""
        self._report.stepped(self.jobs[trial_id], result[REPORT])

    def on_trial_complete(
        self, trial_id: str, result: dict[str, Any] | None = None, error: bool = False
    ) -> None:
        """Register the trial's result, or put back a job that was stopped or whose process or node
        crashed: it resumes from its checkpoints.

        Errors are stored in `stopped_by`, because Tune would count a raised one as the trial's.
        """
        job = self.jobs.pop(trial_id, None)
        if job is None:
            return
        report = (result or {}).get(REPORT, TrialReport())
        try:
            if error:
                self._crashed(job)
            else:
                self._register(job, report)
        except InvalidInput as reason:
            self.stopped_by = reason
            self._search.put_back(job)
        self._report.ended(job, report, error)

    def _crashed(self, job: Job) -> None:
        self._crashes[job.id, job.budget] += 1
        if self._crashes[job.id, job.budget] < MAX_CRASHES:
            self._search.put_back(job)
        else:
            crashed = f"the trial's process died {MAX_CRASHES} times"
            self._search.register(job, None, exception=crashed)

    def _register(self, job: Job, report: TrialReport) -> None:
        if isinstance(report.error, StorageFailure):
            raise report.error
        if isinstance(report.error, UserCodeError) and not self._search.journal.successes:
            raise report.error  # after a success, the hyperparameters are the cause
        if report.error is not None:
            self._search.register(job, None, exception=str(report.error))
        elif not report.budget_reached or report.tally is None:
            self._search.put_back(job)
        elif math.isfinite(objective := report.tally.objective):
            self._search.register(job, objective, report.tally.info)
        else:
            self._search.register(job, None, exception=f"the objective is {objective}")

    def save(self, checkpoint_path: str) -> None:
        """Do nothing: the journal is the search's state."""
