"""`bilevel bohb`: run or resume a study."""

import math
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Self

from bilevel.errors import StorageFailure
from cluster.bohb.handover import Handover
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.validation import SHARE
from cluster.bohb.study.brackets import Schedule, configurations_to_begin
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import Journal
from cluster.bohb.study.profiles import ENDLESS
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.searcher import BohbSearcher
from cluster.bohb.tune.stopping import StudyStopper
from cluster.bohb.tune.tuner import run_trials
from cluster.bohb.view import StudyViews
from cluster.ray.connection import Capacity, require_server_for_nodes, scaled_to
from cluster.ray.pool import EvaluationPool
from cluster.session.context import RunContext
from cluster.session.session import Session
from cluster.session.terminal import count, duration
from cluster.storage.run_folder import RunStatus
from cluster.tracking import Mirror

#: Seconds of a time budget reserved for the end: stopping the trials and scoring the best SE.
_RESERVE = 60.0

#: Most settings in which a prior differs that are told.
_TOLD = 4


@dataclass(frozen=True)
class StudyCommand:
    """A study, and how and where this command runs it."""

    study: Study
    context: RunContext
    brackets: int
    time_budget: float | None  # seconds; None runs all brackets
    final_agents: int  # trained on the best SE at the end, with fresh seeds
    workers_per_trial: int = 1  # 0: as `placed` on the cluster
    concurrent_trials: int | None = None  # None: as many as the cluster's cores hold

    @property
    def trials(self) -> int:
        """Trials at a time on the cluster's current nodes; the number may change during a study."""
        return self.trials_on(Capacity.of_cluster())

    @property
    def cores_wanted(self) -> int:
        """Cores that the study can use at a time: for all configurations that begin in one cycle of
        its brackets."""
        rungs = self.study.schedule.brackets(min(self.brackets, self.study.schedule.cycle))
        trials = self.concurrent_trials or configurations_to_begin(rungs)
        return trials * max(self.workers_per_trial, 1)

    def placed(self, capacity: Capacity) -> Self:
        """The same with a number of workers per trial: if none is given, 1, or more where the
        study has fewer configurations than there are cores."""
        if self.workers_per_trial:
            return self
        begun = configurations_to_begin(self.study.schedule.brackets(self.brackets))
        trials = min(self.concurrent_trials or begun, begun)
        useful = self.study.most_evaluations
        return replace(self, workers_per_trial=min(capacity.fair_share(trials), useful))

    def trials_on(self, capacity: Capacity) -> int:
        """Trials at a time on such a cluster."""
        return self.concurrent_trials or capacity.fair_share(self.workers_per_trial)


def brackets_to_reach(
    journal: Journal, schedule: Schedule, more: int, run_status: RunStatus | None
) -> int:
    """Number of brackets that the study should have.

    An unfinished study completes its planned and open brackets; a complete one gets `more`.
    """
    begun = max((line.id[0] for line in journal.configs), default=-1) + 1
    if run_status is not None and run_status.status != "FINISHED":
        return max(run_status.target, begun, more)
    done = {(line.id, line.budget) for line in journal.results}
    rungs = schedule.brackets(begun)
    complete = len(done) >= sum(rung.configurations for rung in rungs)
    return begun + more if complete else max(begun, more)


def more_than_asked(brackets: int, asked: int, unfinished: bool) -> str | None:
    """What is told of an unfinished study with more brackets than its command has asked for; None
    of any other."""
    if not unfinished or brackets <= asked:
        return None
    if brackets >= ENDLESS:
        return "it was begun without a number of brackets, and goes on until its time is over"
    return f"it was begun with {count(brackets, 'bracket')}, and goes on with these"


def deadlines(started: float, time_budget: float | None) -> tuple[float, float]:
    """When the search is over, and when its validation is, for which SHARE of the time is kept;
    infinite without a time budget. Scoring the best SE, which comes then, has a minute, or half of
    a budget that is shorter than two."""
    budget = math.inf if time_budget is None else time_budget
    time = max(budget - _RESERVE, budget / 2)
    return started + (1 - SHARE) * time, started + time


def run_study(command: StudyCommand) -> int:
    """Run or resume the study; return exit code 0, or 1 if there is no SE to hand over.

    Raises InvalidInput before it runs anything, and StorageFailure if the disk is full.
    """
    study, workers = command.study, max(command.workers_per_trial, 1)
    with (
        command.context.connected(workers, command.concurrent_trials or 1) as driver,
        scaled_to(command.cores_wanted, command.context.address),
        driver.session(study.folder, study.task.id, study.settings()) as session,
    ):
        return _Runner(command.placed(Capacity.of_cluster()), session).run()


class _Runner:
    """Runs a study to its end."""

    def __init__(self, command: StudyCommand, session: Session) -> None:
        self.command = command
        self.session = session
        self.terminal = session.terminal
        study = command.study
        study.write_space()
        self._unlike_prior = study.unlike_prior
        study.take_over_prior()
        self.journal = Journal(study.folder)
        run_status = RunStatus.load(study.folder)
        self._unfinished = run_status is not None and run_status.status != "FINISHED"
        self.brackets = brackets_to_reach(
            self.journal, study.schedule, self.command.brackets, run_status
        )
        StudySummary.of(self.journal)  # raises InvalidInput now, not at the end
        self.search = BracketSearch.of(study, self.journal, self.brackets)
        self.handover = Handover(study, self.journal, session)

    def run(self) -> int:
        """Run to the end; return the exit code."""
        study = self.command.study
        self._introduce()
        views = StudyViews(study, self.session.identity, live=True, journal=self.journal)
        resume_hint = "run the same command again to resume"
        with self.session.live(views, self.brackets, resume_hint) as mirror:
            try:
                code = self._to_the_end(views, mirror)
            except KeyboardInterrupt:
                with suppress(StorageFailure):
                    self.handover.interrupted()
                raise
            finally:
                views.running.clear()
            self.session.status = "FINISHED" if code == 0 else "FAILED"
            return code

    def _introduce(self) -> None:
        command, log = self.command, self.terminal.log
        study = command.study
        self.session.introduce(
            f"{study.method_name} on {study.task.id}: study {study.name!r}, "
            f"space {study.space.name}, recipe {study.base.recipe}, prior {study.prior}, "
            f"{study.start}rule {study.base.nes.update}, "
            f"budgets {'/'.join(map(str, study.schedule.budgets))} core seconds, "
            f"{count(command.trials, 'trial')} at a time with "
            f"{count(command.workers_per_trial, 'worker')} each"
        )
        if study.moved:
            told = ", ".join(f"{name} {was} to {now}" for name, (was, now) in study.moved.items())
            log(f"the recipe lies outside of the space; the search begins nearest to it: {told}")
        unlike = self._unlike_prior
        if unlike:
            told = ", ".join(unlike[:_TOLD]) + (", ..." if len(unlike) > _TOLD else "")
            log(f"the prior {study.prior!r} had {told}: its objectives may be others")
        if command.time_budget is not None:
            log(f"time budget {duration(command.time_budget)}, its last quarter for validation")
        if self.journal.results:
            found = count(len(self.journal.results), "result")
            log(f"resuming with the {found} of this study so far")
        elif self.journal.configs:
            begun = count(len(self.journal.configs), "configuration")
            log(f"resuming {begun} of this study from checkpoints; none has a result yet")
        more = more_than_asked(self.brackets, command.brackets, self._unfinished)
        if more is not None:
            log(more)

    def _pool(self) -> EvaluationPool:
        """A pool as large as those of all trials together, for use while no trial runs."""
        return EvaluationPool(self.command.workers_per_trial * self.command.trials)

    def _to_the_end(self, views: StudyViews, mirror: Mirror) -> int:
        command, log = self.command, self.terminal.log

        def trials() -> int:
            require_server_for_nodes(command.context.tracking_uri)  # a node may have joined
            return command.trials

        deadline, end = deadlines(self.terminal.started, command.time_budget)
        searcher = BohbSearcher(self.search, trials, deadline, command.workers_per_trial)
        report = StudyReport(
            self.brackets, deadline, self.journal, searcher, views, mirror, self.terminal
        )
        with self.session.guard.orderly():
            run_trials(
                command.study,
                command.workers_per_trial,
                searcher,
                StudyStopper(searcher, self.session.guard),
                report,
            )
        self.session.guard.check()
        if searcher.stopped_by is not None:
            raise searcher.stopped_by
        if searcher.time_is_up and not self.search.finished:
            log("the time for the search is over; run the same command again to resume it")
        if searcher.core_utilisation > 0:
            log(
                f"evaluations took {searcher.core_utilisation:.0%} of the cores' time while trials "
                "ran"
            )
        mirror.mark([views.parent])
        with self._pool() as pool:
            found = self.handover.finish(pool, command.final_agents, lambda: time.monotonic() > end)
        return 0 if found else 1
