"""Progress of a running study: lines in the terminal, and changes for MLflow.

Everything that the report shows is already on disk.
"""

import math
import time
from dataclasses import dataclass

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.bracket_search import Job
from cluster.bohb.search.objective import Tally
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.tune.trial import TrialReport
from cluster.bohb.view import StudyViews, study_points
from cluster.session.terminal import Terminal, count, duration, last_line
from cluster.tracking import Mirror


@dataclass
class StudyReport:
    """Follows the jobs of one study."""

    brackets: int
    deadline: float  # of the search, seconds of time.monotonic
    views: StudyViews
    mirror: Mirror
    terminal: Terminal

    #: Seconds, and relative growth of the number of results, between updates of the study's
    #: pictures and tables. Updates take longer the more results there are.
    PICTURES_EVERY, PICTURES_GROWTH = 20.0, 1.1

    def __post_init__(self) -> None:
        rungs = self.views.study.schedule.brackets(self.brackets)
        self._journal = self.views.journal
        self._summary = StudySummary(self._journal, rungs)
        #: Time and number of results of the last pictures.
        self._pictures = (0.0, len(self._journal.results))
        self._started = time.monotonic()
        self._left_before = self._summary.core_seconds_left()

    def started(self, job: Job) -> None:
        """Show that a job starts, or restarts after a crash."""
        name = configuration_name(job.id)
        self.views.running.add(name)
        self.mirror.mark([self.views.key(name)])
        self._bar(f"{name} begins")

    def stepped(self, job: Job, report: TrialReport) -> None:
        """Show a finished generation."""
        if report.point is not None and report.tally is not None:
            name, score = configuration_name(job.id), report.point.values["score_mean"]
            self.mirror.append(self.views.key(name), [report.point])
            self._bar(f"{name} {report.tally.cost:.0f}/{job.budget}s: {score:.1f}")

    def ended(self, job: Job, report: TrialReport, died: bool = False) -> None:
        """Show a job that is complete, stopped or failed, after the journal has its result. If its
        process has died, it runs again, or failed after many crashes."""
        name = configuration_name(job.id)
        self.views.running.discard(name)
        self.mirror.mark([self.views.key(name)])
        if died:
            self.terminal.log(f"{name}: the trial's process died")
        elif report.error is not None:
            self.terminal.log(f"{name} failed: {last_line(str(report.error))}")
        elif report.tally is not None and report.budget_reached:
            self._log_result(job, report.tally)
        # Add the last result to the study's own run, and sometimes update its pictures.
        number, now = len(self._journal.results), time.monotonic()
        drawn_at, drawn = self._pictures
        if now - drawn_at >= self.PICTURES_EVERY and number >= self.PICTURES_GROWTH * drawn:
            self._pictures = now, number
            self.mirror.mark([self.views.parent])
        else:
            points = [point for point in study_points(self._summary) if point.step == number]
            self.mirror.append(self.views.parent, points)

    def _log_result(self, job: Job, tally: Tally) -> None:
        """Log the result in a line of 80 columns, and the configuration in another one."""
        leader = self._summary.leader
        # Results compete at the largest budget that has any.
        best = "" if leader is None else f" (best at {leader.budget}: {leader.loss:.0f})"
        self.terminal.log(
            f"{configuration_name(job.id)} {Tally.describe(tally.info)}; "
            f"objective {tally.objective:.0f}{best}"
        )
        values = (
            f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in job.configuration.items()
        )
        self.terminal.log(f"    {job.origin}: {', '.join(values)}")

    def _bar(self, now: str) -> None:
        """Show progress in minutes of the time budget, or else in results."""
        results, elapsed = len(self._journal.results), time.monotonic() - self._started
        if math.isfinite(self.deadline):
            end = (self.deadline - self._started) / 60
            note = f"{count(results, 'result')}, {now}"
            self.terminal.bar("searching", elapsed / 60, end, "min", note)
        else:
            total = sum(rung.configurations for rung in self._summary.rungs)
            left = self._summary.core_seconds_left()
            done = self._left_before - left
            eta = f"ETA {duration(left * elapsed / done)}, " if done and left else ""
            self.terminal.bar("searching", results, total, "results", eta + now)
