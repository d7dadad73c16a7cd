"""The search as Ray Tune sees it: a `Searcher` under Tune's FIFO scheduler, and its trials.

A Tune trial is one job (configuration, budget). A promoted configuration is a new trial that
continues from the checkpoints of its lower rung.
"""

import logging
import math
import os
import shutil
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from ray import tune
from ray.tune.search import Searcher

from bilevel.errors import InvalidInput, StorageFailure
from bilevel.user_code import UserCodeError
from cluster.bohb.search.bracket_search import BracketSearch, Job
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import ConfigId
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.trial import JOB, REPORT, NESTrial, TrialReport
from cluster.ray.connection import environment_kept
from cluster.session.interrupts import InterruptGuard

#: Folder of Tune's own files within the study's folder; the study never reads them.
_FOLDER = "ray"
#: Settings of Tune that have no parameter (see the package's docstring for the reasons).
_ENVIRONMENT = {
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
    "TUNE_DISABLE_SIGINT_HANDLER": "1",
    "TUNE_GLOBAL_CHECKPOINT_S": "3600",
}

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
            if not error:
                self._register(job, report)
            elif self._crashes[job.id, job.budget] + 1 < MAX_CRASHES:
                self._crashes[job.id, job.budget] += 1
                self._search.put_back(job)
            else:
                crashed = f"the trial's process died {MAX_CRASHES} times"
                self._search.register(job, None, exception=crashed)
        except InvalidInput as reason:
            self.stopped_by = reason
            self._search.put_back(job)
        self._report.ended(job, report, error)

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


class _Stopper(DriverOnly, tune.Stopper):  # type: ignore[misc]
    """Stops all trials at the deadline, after an error such as a full disk, or after Ctrl-C."""

    def __init__(self, searcher: BohbSearcher, guard: InterruptGuard) -> None:
        self._searcher = searcher
        self._guard = guard

    def __call__(self, trial_id: str, result: dict[str, Any]) -> bool:
        return False  # never stop a single trial

    def stop_all(self) -> bool:
        searcher = self._searcher
        return self._guard.interrupted or searcher.time_is_up or searcher.stopped_by is not None


def run_trials(
    study: Study, workers_per_trial: int, searcher: BohbSearcher, guard: InterruptGuard
) -> None:
    """Run the searcher's jobs until it has no more, its deadline, an error, or Ctrl-C."""
    trainable = tune.with_parameters(NESTrial, study=study, workers=workers_per_trial)
    bundles: list[dict[str, float]] = [{}, *({"CPU": 1.0} for _ in range(workers_per_trial))]
    shutil.rmtree(study.folder / _FOLDER, ignore_errors=True)
    for name in ("ray.tune", "hpbandster"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with environment_kept(*_ENVIRONMENT):
        os.environ.update(_ENVIRONMENT)
        tune.Tuner(
            tune.with_resources(trainable, tune.PlacementGroupFactory(bundles)),
            tune_config=tune.TuneConfig(search_alg=searcher, num_samples=-1, reuse_actors=True),
            run_config=tune.RunConfig(
                name=_FOLDER,
                storage_path=str(study.folder),
                stop=_Stopper(searcher, guard),
                checkpoint_config=tune.CheckpointConfig(checkpoint_at_end=False),
                failure_config=tune.FailureConfig(max_failures=0),
                verbose=0,
            ),
        ).fit()
    shutil.rmtree(study.folder / _FOLDER, ignore_errors=True)
