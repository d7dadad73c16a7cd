"""Progress of a running study: lines in the terminal, and changes for MLflow.

The report is a Ray Tune callback in the driver. Everything that it shows is already on disk.
"""

import math
import time
from typing import Any

from ray.tune import Callback

from bilevel.errors import StorageFailure
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.bracket_search import Job
from cluster.bohb.search.objective import Tally
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import Journal
from cluster.bohb.tune.searcher import BohbSearcher, DriverOnly
from cluster.bohb.tune.trial import REPORT, TrialReport
from cluster.bohb.view import StudyViews, study_points
from cluster.session.terminal import Terminal, count, duration, last_line
from cluster.tracking import Mirror, Point


class StudyReport(DriverOnly, Callback):  # type: ignore[misc]
    """Follows the trials of one study."""

    #: Seconds, and relative growth of the number of results, between updates of the study's
    #: pictures and tables. Updates take longer the more results there are.
    PICTURES_EVERY, PICTURES_GROWTH = 20.0, 1.1

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
        self._pictures = (0.0, len(journal.results))  # time and number of results of the last ones
        self._started = time.monotonic()
        self._spent: dict[str, float] = {}  # estimated core seconds of this process, by trial

    # -- called by Ray Tune ------------------------------------------------------

    def on_trial_start(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Show that a job starts, or restarts after a crash."""
        job = self._searcher.jobs[trial.trial_id]
        self._jobs[trial.trial_id] = job
        name = configuration_name(job.id)
        self._views.running.add(name)
        self._mirror.mark([self._views.key(name)])
        self._bar(f"{name} starts")

    def on_trial_result(
        self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
    ) -> None:
        """Show a finished generation."""
        report: TrialReport = result[REPORT]
        if report.tally is None:
            return
        job = self._jobs[trial.trial_id]
        name = configuration_name(job.id)
        for line in report.messages:
            self._terminal.log(line)
        self._spent[trial.trial_id] = report.spent
        if report.record is not None:
            point = Point.of(report.record, report.before, run=report.run)
            self._mirror.append(self._views.key(name), [point])
            done = f"{name} {report.tally.cost:.0f}/{job.budget}s"
            self._bar(f"{done}: {report.record.score_mean:.1f}")

    def on_trial_complete(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Show a job that is complete, stopped or failed; the journal already has its result."""
        job = self._close(trial.trial_id)
        report: TrialReport = (trial.last_result or {}).get(REPORT, TrialReport())
        if job is None or isinstance(report.error, StorageFailure):
            return
        if report.error is not None:
            self._log_failure(job, str(report.error))
        elif report.tally is not None and report.budget_reached:
            self._log_result(job, report.tally)
        self._show_result()

    def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Show that a trial's process died: its job runs again, or failed after many crashes."""
        job = self._close(trial.trial_id)
        if job is None:
            return
        last = self._journal.results[-1] if self._journal.results else None
        if last is not None and (last.id, last.budget) == (job.id, job.budget):
            self._log_failure(job, last.exception or "")
        else:
            name = configuration_name(job.id)
            self._terminal.log(f"{name}: the trial's process died; it is restarted")

    # -- MLflow ------------------------------------------------------------------

    def _close(self, trial_id: str) -> Job | None:
        job = self._jobs.pop(trial_id, None)
        if job is not None:
            name = configuration_name(job.id)
            self._views.running.discard(name)
            self._mirror.mark([self._views.key(name)])
        return job

    def _show_result(self) -> None:
        """Add the last result to the study's own run, and sometimes update its pictures."""
        number, now = len(self._journal.results), time.monotonic()
        drawn_at, drawn = self._pictures
        if now - drawn_at >= self.PICTURES_EVERY and number >= self.PICTURES_GROWTH * drawn:
            self._pictures = now, number
            self._mirror.mark([self._views.parent])
        else:
            points = [point for point in study_points(self._summary) if point.step == number]
            self._mirror.append(self._views.parent, points)

    # -- terminal ----------------------------------------------------------------

    def _log_failure(self, job: Job, reason: str) -> None:
        self._terminal.log(f"{configuration_name(job.id)} failed: {last_line(reason)}")

    def _log_result(self, job: Job, tally: Tally) -> None:
        """Log the result in a line of 80 columns, and the configuration in another one."""
        leader, seconds = self._summary.leader, self._seconds_left()
        # Results compete at the largest budget that has any.
        best = "" if leader is None else f" (best at {leader.budget}: {leader.loss:.0f})"
        left = f"; {duration(seconds)} left" if math.isfinite(seconds) else ""
        self._terminal.log(
            f"{configuration_name(job.id)} {Tally.describe(tally.info)}; "
            f"objective {tally.objective:.0f}{best}{left}"
        )
        values = (
            f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in job.configuration.items()
        )
        self._terminal.log(f"    {job.origin}: {', '.join(values)}")

    def _bar(self, now: str) -> None:
        """Show progress in minutes if the time budget ends the study, else in results."""
        results, seconds = len(self._journal.results), self._seconds_left()
        if self._brackets_left() <= self._time_left():
            total = sum(rung.configurations for rung in self._rungs)
            self._terminal.bar("searching", results, total, "results", now, seconds)
        else:
            minutes = (self._deadline - self._terminal.started) / 60
            note = f"{count(results, 'result')}, {now}"
            self._terminal.bar("searching", minutes - seconds / 60, minutes, "min", note)

    def _seconds_left(self) -> float:
        return min(self._brackets_left(), self._time_left())

    def _brackets_left(self) -> float:
        """Estimate the seconds until all brackets are complete from this process's speed so far;
        infinite before its first generation."""
        left, spent = self._summary.core_seconds_left(), sum(self._spent.values())
        if left and not spent:
            return math.inf
        return (time.monotonic() - self._started) / max(spent, 1e-9) * left

    def _time_left(self) -> float:
        return self._deadline - time.monotonic()
