"""`bilevel bohb`: run or resume a study, or estimate its cost."""

import math
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Self

from bilevel.errors import InvalidInput
from cluster.bohb.finish import StudyEnd
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.validation import SHARE, validation_seconds
from cluster.bohb.study.brackets import Schedule, core_seconds_to_run, initial_configurations
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import Journal
from cluster.bohb.study.profiles import Profile
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.searcher import BohbSearcher, run_trials
from cluster.bohb.view import StudyViews
from cluster.ray.connection import cluster_cores, require_cores, require_server_for_nodes
from cluster.ray.pool import EvaluationPool
from cluster.session.context import RunContext, Session
from cluster.session.terminal import Terminal, count, duration
from cluster.storage.home import require_writable
from cluster.storage.run_folder import RunStatus, check_settings
from cluster.tracking import Mirror

#: Seconds of a time budget for stopping the trials and scoring the best SE.
_RESERVE = 60.0


@dataclass(frozen=True)
class StudyCommand:
    """A study, and how and where this command runs it."""

    study: Study
    context: RunContext
    profile: Profile
    workers_per_trial: int = 1  # 0 until `with_workers` sets it
    concurrent_trials: int | None = None  # None fills the cluster's cores

    def with_workers(self, cores: int) -> Self:
        """Choose the workers per trial unless they are given: 1, or more if the study has fewer
        configurations than the cluster has `cores`."""
        if self.workers_per_trial:
            return self
        started = initial_configurations(self.study.schedule.brackets(self.profile.brackets))
        trials = min(self.concurrent_trials or started, started)
        workers = min(max(cores // trials, 1), self.study.base.nes.evaluations)
        return replace(self, workers_per_trial=workers)

    def trials_on(self, cores: int) -> int:
        """Return the number of concurrent trials on a cluster, at least 1."""
        return self.concurrent_trials or max(cores // self.workers_per_trial, 1)


def brackets_to_reach(
    journal: Journal, schedule: Schedule, requested: int, run_status: RunStatus | None
) -> int:
    """Return the number of brackets to run: an unfinished study completes its planned brackets, and
    a complete one gets `requested` more."""
    started = max((line.id[0] for line in journal.configs), default=-1) + 1
    planned = sum(rung.configurations for rung in schedule.brackets(started))
    complete = len(journal.results) >= planned
    target = 0
    if run_status is not None and run_status.status != "FINISHED":
        target = run_status.target
        complete = complete and run_status.status == "FAILED" and started >= target
    return started + requested if complete else max(target, started, requested)


def deadlines(started: float, time_budget: float | None) -> tuple[float, float]:
    """Return the deadlines of the search and of its validation; infinite without a time budget."""
    budget = math.inf if time_budget is None else time_budget
    end = max(budget - _RESERVE, budget / 2)
    return started + (1 - SHARE) * end, started + end


def run_study(command: StudyCommand) -> int:
    """Run or resume the study; return exit code 0, or 1 without an SE.

    Raises InvalidInput before it runs anything, and StorageFailure if the disk is full.
    """
    study, workers = command.study, max(command.workers_per_trial, 1)
    study.prior_configuration()  # raises InvalidInput
    with (
        command.context.connected(workers, command.concurrent_trials or 1) as driver,
        driver.session(study.folder, study.task.id, study.settings()) as session,
    ):
        return _Runner(command.with_workers(cluster_cores()), session).run()


def estimate(command: StudyCommand) -> None:
    """Print the brackets, their cost, and whether the cluster can place the trials.

    Raises InvalidInput where the study would.
    """
    study, schedule, brackets = command.study, command.study.schedule, command.profile.brackets
    study.prior_configuration()
    require_writable(command.context.home.folder)
    check_settings(study.folder, study.settings())
    available = command.context.cores()
    command = command.with_workers(available)
    trials, workers = command.trials_on(available), command.workers_per_trial
    require_cores(available, workers, trials)
    rungs = schedule.brackets(brackets)
    searched = core_seconds_to_run(rungs)
    validated = validation_seconds(searched)
    cores = trials * workers
    with Terminal() as terminal:
        terminal.log(study.title)
        terminal.log("bracket   configurations x core seconds")
        for bracket in range(min(brackets, schedule.cycle)):
            row = (f"{rung.configurations} x {rung.budget}" for rung in schedule.bracket(bracket))
            terminal.log(f"{bracket:7d}   {' -> '.join(row)}")
        if brackets > schedule.cycle:
            terminal.log("    ...   and so on")
        terminal.log(
            f"{count(brackets, 'bracket')}: {initial_configurations(rungs)} configurations, "
            f"{searched} core seconds and {validated:.0f} of validation: about "
            f"{duration((searched + validated) / cores)} on {count(cores, 'core')}"
        )
        if command.profile.time_budget is not None:
            terminal.log(f"the time budget ends it after {duration(command.profile.time_budget)}")
        terminal.log(f"{count(trials, 'trial')} at a time, {count(workers, 'worker')} each")


class _Runner:
    def __init__(self, command: StudyCommand, session: Session) -> None:
        self.command = command
        self.session = session
        self.terminal = session.terminal
        study = command.study
        study.write_space()
        self.journal = Journal(study.folder)
        run_status = RunStatus.load(study.folder)
        self.brackets = brackets_to_reach(
            self.journal, study.schedule, command.profile.brackets, run_status
        )
        self.search = BracketSearch(study, self.journal, self.brackets)
        self.end = StudyEnd(study, self.journal, session)

    def run(self) -> int:
        """Run the study to its end; return the exit code."""
        command, study, log = self.command, self.command.study, self.terminal.log
        self.session.introduce(
            f"{study.title}, space {study.space.name}, recipe {study.base.recipe}, prior "
            f"{study.prior}, budgets {'/'.join(map(str, study.schedule.budgets))} core seconds, "
            f"{count(self._trials(), 'trial')} at a time with "
            f"{count(command.workers_per_trial, 'worker')} each"
        )
        if (time_budget := command.profile.time_budget) is not None:
            log(f"time budget {duration(time_budget)}")
        if self.journal.configs:
            results = count(len(self.journal.results), "result")
            log(f"resuming {count(len(self.journal.configs), 'configuration')} with {results}")
        views = StudyViews(command.study.folder, live=True, journal=self.journal)
        resume_hint = "run the same command again to resume"
        with self.session.live(views, self.brackets, resume_hint) as mirror:
            try:
                deadline, end = deadlines(self.terminal.started, command.profile.time_budget)
                self._search(views, mirror, deadline)
                with EvaluationPool(command.workers_per_trial * self._trials()) as pool:
                    found = self.end.finish(
                        pool, command.profile.final_agents, lambda: time.monotonic() > end
                    )
            except KeyboardInterrupt:
                with suppress(InvalidInput):
                    self.end.export_interrupted()
                raise
            finally:
                views.running.clear()
            self.session.status = "FINISHED" if found else "FAILED"
            return 0 if found else 1

    def _trials(self) -> int:
        """Return the number of concurrent trials on the cluster's current nodes."""
        require_server_for_nodes(self.command.context.tracking_uri)  # a node may have joined
        return self.command.trials_on(cluster_cores())

    def _search(self, views: StudyViews, mirror: Mirror, deadline: float) -> None:
        command = self.command
        report = StudyReport(self.brackets, deadline, views, mirror, self.terminal)
        searcher = BohbSearcher(self.search, self._trials, deadline, report)
        guard = self.session.guard
        with guard.orderly():
            run_trials(command.study, command.workers_per_trial, searcher, guard)
        guard.check()
        if searcher.stopped_by is not None:
            raise searcher.stopped_by
        if searcher.time_is_up and not self.search.finished:
            self.terminal.log(
                "the search has reached its time limit; run the same command again to resume it"
            )
        mirror.mark([views.parent])
