"""`bilevel bohb`: run or resume a study."""

import math
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Self

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, StorageFailure
from bilevel.synthetic_env import save_se
from cluster.bohb.brackets import Schedule, configurations_to_begin
from cluster.bohb.journal import Journal, ResultLine
from cluster.bohb.objective import Tally
from cluster.bohb.report import StudyReport
from cluster.bohb.runs import ConfigurationRuns
from cluster.bohb.search import BracketSearch
from cluster.bohb.searcher import BohbSearcher
from cluster.bohb.stopping import StudyStopper
from cluster.bohb.study import RECIPE_FILE, Study, configuration_name
from cluster.bohb.summary import StudySummary
from cluster.bohb.tuning import run_trials
from cluster.bohb.view import StudyViews
from cluster.nes.run import start_of
from cluster.nes.selection import (
    RACERS,
    Contender,
    agents_needed,
    choose_best,
    evaluate_holdout,
    export_best,
    in_time,
    race,
)
from cluster.ray.connection import Capacity, require_server_for_nodes, scaled_to
from cluster.ray.pool import EvaluationPool
from cluster.session.context import RunContext
from cluster.session.session import Session
from cluster.session.terminal import count, duration
from cluster.storage.run_folder import RunStatus
from cluster.tracking import Mirror
from cluster.tracking.registry import model_address

#: Seconds of a time budget reserved for the end: stopping the trials and scoring the best SE.
_RESERVE = 60.0

#: File with the incumbent's best SE, of a search that was interrupted.
INCUMBENT_FILE = "incumbent_se.safetensors"


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
        useful = self.study.base.nes.evaluations
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


def run_study(command: StudyCommand) -> int:
    """Run or resume the study; return exit code 0, or 1 if no trial succeeded.

    Raises InvalidInput before anything is written, and StorageFailure if the disk is full.
    """
    study, workers = command.study, max(command.workers_per_trial, 1)
    with (
        command.context.connected(workers, command.concurrent_trials or 1) as driver,
        scaled_to(command.cores_wanted),
        driver.session(study.folder, study.task.id, study.settings()) as session,
    ):
        return _Runner(command.placed(Capacity.of_cluster()), session).run()


class _Runner:
    """Runs a study to its end."""

    def __init__(self, command: StudyCommand, session: Session) -> None:
        self.command = command
        self.session = session
        self.terminal = session.terminal
        self.live: set[str] = set()  # names of configurations
        study = command.study
        study.take_over_prior()
        self.journal = Journal(study.folder)
        run_status = RunStatus.load(study.folder)
        self._unfinished = run_status is not None and run_status.status != "FINISHED"
        self.brackets = brackets_to_reach(
            self.journal, study.schedule, self.command.brackets, run_status
        )
        self.search = BracketSearch.of(study, self.journal, self.brackets)

    def run(self) -> int:
        """Run to the end; return the exit code."""
        study = self.command.study
        study.write_space()
        self._introduce()
        views = StudyViews(study, self.session.identity, self.live)
        goes_on = "run the same command again to resume"
        with self.session.live(views, self.brackets, goes_on) as mirror:
            try:
                code = self._to_the_end(views, mirror)
            except KeyboardInterrupt:
                with suppress(StorageFailure):
                    self._export_unfinished()
                raise
            finally:
                self.live.clear()
            self.session.status = "FINISHED" if code == 0 else "FAILED"
            return code

    def _introduce(self) -> None:
        command, line = self.command, self.terminal.line
        study = command.study
        self.session.introduce(
            f"{study.method_name} on {study.task.id}: study {study.name!r}, "
            f"space {study.space.name}, recipe {study.base.recipe}, prior {study.prior}, "
            f"{start_of(study.base.nes)}, "
            f"rule {study.base.nes.update}, "
            f"budgets {'/'.join(map(str, study.schedule.budgets))} core seconds, "
            f"{command.trials} trial(s) at a time with {command.workers_per_trial} worker(s) each"
        )
        if command.time_budget is not None:
            line(f"time budget {duration(command.time_budget)}")
        if self.journal.results:
            found = count(len(self.journal.results), "result")
            line(f"resuming with the {found} of this study so far")
        elif self.journal.configs:
            begun = count(len(self.journal.configs), "configuration")
            line(f"resuming {begun} of this study from checkpoints; none has a result yet")
        if self._unfinished and self.brackets > command.brackets and command.time_budget is None:
            line(f"it was begun with {count(self.brackets, 'bracket')}, which it completes")

    @property
    def _budget(self) -> float:
        """The time budget in seconds, infinite where there is none."""
        return math.inf if self.command.time_budget is None else self.command.time_budget

    def _time_is_up(self) -> bool:
        return time.monotonic() > self.terminal.started + self._budget

    def _pool(self) -> EvaluationPool:
        """A pool as large as those of all trials together, for use while no trial runs."""
        return EvaluationPool(self.command.workers_per_trial * self.command.trials)

    def _to_the_end(self, views: StudyViews, mirror: Mirror) -> int:
        command, line = self.command, self.terminal.line

        def trials() -> int:
            require_server_for_nodes(command.context.tracking_uri)  # a node may have joined
            return command.trials

        deadline = self.terminal.started + max(self._budget - _RESERVE, self._budget / 2)
        searcher = BohbSearcher(self.search, trials, deadline, command.workers_per_trial)
        report = StudyReport(
            command.study,
            self.brackets,
            deadline,
            self.journal,
            searcher,
            views,
            self.live,
            mirror,
            self.terminal,
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
            line("the time budget is spent; run the same command again to resume")
        if searcher.core_utilisation > 0:
            line(
                f"evaluations took {searcher.core_utilisation:.0%} of the cores' time while trials "
                "ran"
            )
        mirror.mark([views.parent])
        return self._finish()

    def _finish(self) -> int:
        """Choose the best SE of all configurations, and score it with fresh agents."""
        study, line = self.command.study, self.terminal.line
        with self._pool() as pool:
            contenders = self._contenders(pool)
            if not contenders:
                line(
                    "no configuration finished a generation: see the errors above"
                    if self.journal.results
                    else "no configuration finished a generation in this time"
                )
                return 1
            if len(contenders) > 1:
                line(f"retesting the {len(contenders)} best SEs with fresh agents")
            rounds = race(self.command.final_agents)
            self.terminal.bar("retesting", 0, agents_needed(len(contenders), rounds), "tests")
            step = self.terminal.step
            asked = in_time(rounds, self._time_is_up)
            best = choose_best(study.task, contenders, (study.seed,), pool, step, asked)
            score = evaluate_holdout(
                study.task, best, self.command.final_agents, (study.seed,), pool
            )
        path = export_best(best.se, score, study.folder, len(self.journal.results))
        (study.folder / INCUMBENT_FILE).unlink(missing_ok=True)  # of an interruption before
        incumbent = self._say_incumbent()
        line(str(score))
        if incumbent is not None:
            call = self.command.context.home.hint(f"nes {study.task.id} --recipe {study.name}")
            line(f"its recipe: {study.folder / RECIPE_FILE}; learn an SE by it with {call}")
            if len(self.journal.configs) > 1:
                line(
                    "the best of several configurations was also lucky: with other seeds, expect "
                    "its recipe to take longer than its objective tells (docs/tuning.md)"
                )
        model = model_address(study.task.id, "newest")
        line(f"best SE: {path}  ({model} in MLflow's model registry)")
        line(f"results: {self.session.shown_at(self.session.identity.uuid)}")
        line("run the same command again to add brackets")
        return 0 if any(result.loss is not None for result in self.journal.results) else 1

    def _contenders(self, pool: EvaluationPool) -> list[Contender]:
        """The SEs of all configurations that were confirmed, then those that scored highest in
        their own runs. A damaged or lost checkpoint is recomputed."""
        reached: dict[object, int] = {}
        for result in self.journal.results:
            if result.loss is not None:
                reached[result.id] = max(result.budget, reached.get(result.id, 0))
        found = []
        for line in self.journal.configs:
            try:
                runs = ConfigurationRuns.open(
                    self.command.study, line.id, line.configuration, self.terminal.line
                )
            except InvalidInput:  # it failed, because its values do not fit together
                continue
            runs.spend(reached.get(line.id, 0), pool)
            for state in runs.states:
                ses = [state.best] if state.confirmed else state.candidates
                hp = runs.run(0).hp
                found += [
                    ((state.confirmed, finalist.rank), Contender(se, hp))
                    for finalist, se in zip(state.finalists, ses, strict=False)
                ]
        found.sort(key=lambda pair: pair[0], reverse=True)
        return [contender for _, contender in found[:RACERS]]

    def _export_unfinished(self) -> None:
        """Say what the interrupted search has found, and save its best SE."""
        incumbent = self._say_incumbent()
        if incumbent is None:
            return
        study = self.command.study
        configuration = self._summary.configuration(incumbent.id)
        best = ConfigurationRuns.read(study, incumbent.id, configuration).best
        if best is not None:
            path = study.folder / INCUMBENT_FILE
            save_se(best, path)
            self.terminal.line(f"its best SE, not retested: {path}")

    @property
    def _summary(self) -> StudySummary:
        return StudySummary(self.journal, self.command.study.schedule.brackets(self.brackets))

    def _say_incumbent(self) -> ResultLine | None:
        line = self.terminal.line
        summary = self._summary
        line(
            f"{count(len(self.journal.results), 'result')} of "
            f"{count(len(self.journal.configs), 'configuration')} "
            f"({summary.model_based} proposed by the model)"
        )
        incumbent = summary.incumbent
        if incumbent is None:
            return None
        line(
            f"incumbent {configuration_name(incumbent.id)}: {Tally.told(incumbent.info)}, "
            f"objective {incumbent.loss:.0f}"
        )
        found = summary.configuration(incumbent.id)
        text = self.command.study.recipe_text(incumbent.id, found)
        write_aside(self.command.study.folder / RECIPE_FILE, text.encode())
        for name, value in found.items():
            line(f"  {name} = {value:.6g}" if isinstance(value, float) else f"  {name} = {value}")
        return incumbent
