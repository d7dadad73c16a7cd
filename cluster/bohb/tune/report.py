"""Progress of a running study: lines in the terminal, and changed runs marked for MLflow.

The report is a Ray Tune callback in the driver. It shows only what is already on disk, so it may
show anything again.
"""

import math
import time
from typing import Any

from ray.tune import Callback

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.bracket_search import Job
from cluster.bohb.search.objective import Tally
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import Journal
from cluster.bohb.tune.searcher import BohbSearcher, DriverOnly
from cluster.bohb.tune.trial import (
    BUDGET_REACHED,
    FAILURE,
    MESSAGES,
    MISTAKE,
    NO_STORAGE,
    OBJECTIVE,
    RECORD,
    SPENT,
    TALLY,
)
from cluster.bohb.view import StudyViews
from cluster.session.terminal import Terminal, count, duration, last_line
from cluster.tracking import Mirror

#: Seconds between refreshed pictures on the study's own run.
_PICTURE_EVERY = 20.0


class StudyReport(DriverOnly, Callback):  # type: ignore[misc]
    """Follows the trials of one study, and tells its views which configurations run."""

    def __init__(
        self,
        brackets: int,
        deadline: float,
        journal: Journal,
        searcher: BohbSearcher,
        views: StudyViews,
        mirror: Mirror,
        terminal: Terminal,
    ) -> None:
        self._deadline = deadline  # of the search, seconds of time.monotonic
        self._journal = journal
        self._searcher = searcher
        self._views = views
        self._mirror = mirror
        self._terminal = terminal
        self._rungs = views.study.schedule.brackets(brackets)
        self._summary = StudySummary(journal, self._rungs)
        self._jobs: dict[str, Job] = {}  # by trial
        self._last_picture = 0.0
        self._started = time.monotonic()  # of the trials
        self._spent: dict[str, float] = {}  # estimated core seconds of this process, by trial

    # -- trials (called by Ray Tune) -------------------------------------------

    def on_trial_start(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Show that a configuration's run begins, or continues after a promotion."""
        job = self._searcher.jobs[trial.trial_id]
        self._jobs[trial.trial_id] = job
        self._views.running.add(configuration_name(job.id))
        self._mark(job)
        self._show(f"{configuration_name(job.id)} begins")

    def on_trial_result(
        self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
    ) -> None:
        """Show a finished generation."""
        if TALLY not in result:
            return
        job = self._jobs[trial.trial_id]
        for line in result[MESSAGES]:
            self._terminal.log(line)
        self._mark(job)
        self._spent[trial.trial_id] = result[SPENT]
        if result[RECORD] is not None:
            score = result[RECORD].score_mean
            done = f"{configuration_name(job.id)} {result[TALLY].cost:.0f}/{job.budget}s"
            self._show(f"{done}: {score:.1f}")

    def on_trial_complete(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Show a job that is done, stopped or failed; the journal already holds its result."""
        result = trial.last_result or {}
        job = self._close(trial.trial_id)
        if job is None or NO_STORAGE in result:
            return
        if FAILURE in result or MISTAKE in result:
            self._failed(job, str(result.get(FAILURE, result.get(MISTAKE))))
        elif result.get(BUDGET_REACHED):
            self._result_line(job, result)
        if time.monotonic() - self._last_picture >= _PICTURE_EVERY:
            self._last_picture = time.monotonic()
            self._mirror.mark([self._views.parent])

    def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Show that a trial's process died: its job runs again, or failed after too many deaths."""
        job = self._close(trial.trial_id)
        if job is None:
            return
        last = self._journal.results[-1] if self._journal.results else None
        if last is not None and (last.id, last.budget) == (job.id, job.budget):
            self._failed(job, last.exception or "")
        else:
            self._terminal.log(
                f"{configuration_name(job.id)}: the trial's process died; it is started again"
            )

    # -- parts -------------------------------------------------------------------

    def _close(self, trial_id: str) -> Job | None:
        job = self._jobs.pop(trial_id, None)
        if job is not None:
            self._views.running.discard(configuration_name(job.id))
            self._mark(job)
        return job

    def _mark(self, job: Job) -> None:
        self._mirror.mark([self._views.key(configuration_name(job.id))])

    def _failed(self, job: Job, reason: str) -> None:
        self._terminal.log(f"{configuration_name(job.id)} failed: {last_line(reason)}")

    def _show(self, now: str) -> None:
        # Kept short, so that the bar fits into 80 columns.
        results, seconds = len(self._journal.results), self._seconds_left()
        if self._time_decides():
            total = (self._deadline - self._terminal.started) / 60
            done = total - seconds / 60
            note = f"{count(results, 'result')}, {now}"
            self._terminal.bar("searching", done, total, "min", note)
            return
        total = sum(rung.configurations for rung in self._rungs)
        self._terminal.bar("searching", results, total, "results", now, seconds)

    def _result_line(self, job: Job, result: dict[str, Any]) -> None:
        """Two lines, the first one of 80 columns: what came out, and what was tried."""
        leader = self._summary.leader
        # Results compete at the largest budget that any has had.
        best = "" if leader is None else f" (best at {leader.budget}: {leader.loss:.0f})"
        self._terminal.log(
            f"{configuration_name(job.id)} {Tally.describe(result[TALLY].info)}; "
            f"objective {result[OBJECTIVE]:.0f}{best}{self._time_to_go()}"
        )
        tried = (
            f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in job.configuration.items()
        )
        self._terminal.log(f"    {job.origin}: {', '.join(tried)}")

    def _time_to_go(self) -> str:
        seconds = self._seconds_left()
        if math.isinf(seconds):  # a result of an earlier process's generations
            return ""
        left = duration(seconds)
        return f"; {left} left" if self._time_decides() else f"; ETA {left}"

    def _elapsed(self) -> float:
        return time.monotonic() - self._started

    def _time_decides(self) -> bool:
        """Whether the time budget is expected to end the study before its last bracket."""
        return self._seconds_of_brackets() > self._time_left()

    def _seconds_left(self) -> float:
        return min(self._seconds_of_brackets(), self._time_left())

    def _seconds_of_brackets(self) -> float:
        """Estimate from this process's speed so far; infinite before its first generation."""
        left, spent = self._summary.core_seconds_left(), sum(self._spent.values())
        if left and not spent:
            return math.inf
        return self._elapsed() / max(spent, 1e-9) * left

    def _time_left(self) -> float:
        return self._deadline - time.monotonic()
