"""`bilevel bohb`: a study, that is BOHB over NES runs, tracked in MLflow."""

import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ray import tune

from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.bohb.brackets import bracket_table, budget_ladder, generations_to_run
from cluster.bohb.journal import Journal
from cluster.bohb.report import StudyReport
from cluster.bohb.search import BracketSearch
from cluster.bohb.searcher import BohbSearcher
from cluster.bohb.stopping import InterruptGuard, StudyStopper
from cluster.bohb.trial import NESTrial
from cluster.final import choose_best, score_anew
from cluster.home import Home, locked_settings
from cluster.pool import placed_pool
from cluster.profiles import Profile, base_hyperparameters
from cluster.progress import Terminal, duration
from cluster.ray_cluster import cluster_cores, ray_cluster, require_capacity
from cluster.tracking import Tracker
from cluster.tracking.tracker import check_tracking_uri, mlflow_imported_meanwhile
from search_spaces import search_space

#: Seconds of a time budget that are kept for the end: stopping the trials, scoring
#: the best SE anew, registering it.
_RESERVE = 60.0

#: How often a trial that fails is started again before it counts as failed.
_RETRIES = 2


@dataclass(frozen=True)
class StudySettings:
    """A study and where it runs. `model` off leaves Hyperband with random picks."""

    task: Task
    name: str
    profile_name: str
    profile: Profile
    seed: int
    home: Home
    tracking_uri: str
    workers_per_trial: int = 1
    concurrent_trials: int | None = None  # None: as many as the cluster's cores hold
    address: str | None = None
    model: bool = True
    agents: tuple[str, ...] = ("ddqn",)

    @property
    def folder(self) -> Path:
        """The study's folder."""
        return self.home.run_folder(self.task.id, self.name)

    @property
    def ladder(self) -> list[int]:
        """Budgets in generations, ascending."""
        return budget_ladder(self.profile.smallest_budget, self.profile.largest_budget)

    @property
    def base(self) -> Hyperparameters:
        """What a configuration leaves unsaid."""
        return base_hyperparameters(self.profile, self.task, self.agents)

    def fixed(self) -> dict[str, Any]:
        """What must stay the same when the study is continued."""
        return {
            "task": self.task.id,
            "seed": self.seed,
            "space": self.profile.space,
            "budgets": self.ladder,
            "model": self.model,
            "base": self.base.to_dict(),
        }


def concurrency(settings: StudySettings) -> int:
    """Trials at a time. Raises InvalidInput if the cluster cannot place them."""
    trials = settings.concurrent_trials or max(cluster_cores() // settings.workers_per_trial, 1)
    require_capacity(settings.workers_per_trial, trials)
    return trials


def brackets_to_reach(journal: Journal, ladder: list[int], more: int) -> int:
    """How many brackets the study should have: what is open is finished first, and a
    study that is complete gets `more` of them."""
    begun = max((line.id[0] for line in journal.configs), default=-1) + 1
    done = {(line.id, line.budget) for line in journal.results}
    complete = len(done) >= sum(rung.configurations for rung in bracket_table(begun, ladder))
    return begun + more if complete else max(begun, more)


def run_study(settings: StudySettings) -> int:
    """Run (or continue) the study; returns the exit code: 0, 1 if no trial
    succeeded, 130 after Ctrl-C. Raises InvalidInput before anything is written."""
    deadline = time.monotonic() + (
        max(settings.profile.time_budget - _RESERVE, settings.profile.time_budget / 2)
        if settings.profile.time_budget is not None
        else float("inf")
    )
    check_tracking_uri(settings.tracking_uri)
    with Terminal() as terminal, mlflow_imported_meanwhile(), ray_cluster(settings.address):
        trials = concurrency(settings)
        settings.home.prepare()
        tracker = Tracker(settings.tracking_uri, settings.task.id, settings.home.artifacts)
        with locked_settings(settings.folder, settings.fixed()) as identity:
            return _run(settings, identity, tracker, trials, deadline, terminal)


def _run(
    settings: StudySettings,
    identity: str,
    tracker: Tracker,
    trials: int,
    deadline: float,
    terminal: Terminal,
) -> int:
    journal = Journal(settings.folder)
    brackets = brackets_to_reach(journal, settings.ladder, settings.profile.brackets)
    search = BracketSearch(
        search_space(settings.profile.space, settings.agents),
        settings.ladder,
        brackets,
        settings.seed,
        journal,
        settings.model,
    )
    searcher = BohbSearcher(search, trials, deadline, settings.workers_per_trial)
    report = StudyReport(settings, identity, journal, searcher, tracker, terminal, brackets)
    report.begin(trials)
    status = "FAILED"
    try:
        with InterruptGuard(terminal) as guard:
            _tune(settings, searcher, StudyStopper(searcher, guard), report)
        if guard.interrupted:
            status = "KILLED"
            terminal.line("stopped; the same command goes on where it was, nothing is lost")
            return 130
        if searcher.time_is_up and not search.finished:
            terminal.line("the time budget is spent; the same command goes on where it was")
        contenders = report.contenders()
        if not contenders:
            terminal.line("no configuration finished a generation: see the errors above")
            return 1
        with placed_pool(settings.workers_per_trial * trials) as pool:
            terminal.line(f"retesting the {len(contenders)} best SEs with fresh agents")
            best = choose_best(settings.task, contenders, (settings.seed,), pool)
            agents = settings.profile.final_agents
            score = score_anew(settings.task, best, agents, (settings.seed,), pool)
        report.finish(best, score)
        status = "FINISHED"
        return 0 if any(line.loss is not None for line in journal.results) else 1
    finally:
        report.close(status)


def _tune(
    settings: StudySettings, searcher: BohbSearcher, stopper: StudyStopper, report: StudyReport
) -> None:
    trainable = tune.with_parameters(
        NESTrial,
        task=settings.task,
        base=settings.base,
        study_seed=settings.seed,
        study_folder=settings.folder,
        workers=settings.workers_per_trial,
    )
    resources = tune.PlacementGroupFactory([{}] + [{"CPU": 1}] * settings.workers_per_trial)
    with _quiet_tune():
        tune.Tuner(
            tune.with_resources(trainable, resources),
            tune_config=tune.TuneConfig(search_alg=searcher, num_samples=-1, reuse_actors=True),
            run_config=tune.RunConfig(
                name="ray",
                storage_path=str(settings.folder),
                callbacks=[report],
                stop=stopper,
                # The run's own checkpoint is on disk after every generation: a trial
                # that is started again continues from it.
                checkpoint_config=tune.CheckpointConfig(checkpoint_at_end=False),
                failure_config=tune.FailureConfig(max_failures=_RETRIES),
                verbose=0,
            ),
        ).fit()


@contextmanager
def _quiet_tune() -> Iterator[None]:
    """Tune without its own files, messages and signal handling: the journal and the
    checkpoints are the study's state, the report its voice, `InterruptGuard` its
    Ctrl-C."""
    for name in ("ray.tune", "hpbandster"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    wanted = {
        "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
        "TUNE_DISABLE_SIGINT_HANDLER": "1",
        "TUNE_MAX_PENDING_TRIALS_PG": "1",
        "TUNE_GLOBAL_CHECKPOINT_S": "3600",
        "TUNE_RESULT_BUFFER_LENGTH": "0",
    }
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@dataclass(frozen=True)
class Estimate:
    """What a study would cost; for `--dry-run`."""

    generations: int
    evaluations: int
    seconds_per_evaluation: float
    cores: int

    @property
    def seconds(self) -> float:
        """Time on the cluster's cores."""
        return self.evaluations * self.seconds_per_evaluation / self.cores


def dry_run(settings: StudySettings, terminal: Terminal) -> None:
    """Print the bracket table, the cost, and whether the cluster can place it.

    The time is estimated from evaluations of randomly drawn configurations, made
    here and now on one core.
    """
    from bilevel.evaluation import EvaluationRequest, evaluate
    from bilevel.synthetic_env import Architecture
    from search_spaces import to_hyperparameters

    check_tracking_uri(settings.tracking_uri)
    rungs = bracket_table(settings.profile.brackets, settings.ladder)
    with ray_cluster(settings.address):
        trials = concurrency(settings)
    terminal.line(f"study {settings.name!r} on {settings.task.id}, budgets in generations")
    terminal.line("bracket   configurations x budget")
    cycle = len(settings.ladder)
    for bracket in range(min(settings.profile.brackets, cycle)):
        row = " -> ".join(
            f"{rung.configurations} x {rung.budget}" for rung in rungs if rung.bracket == bracket
        )
        terminal.line(f"{bracket:7d}   {row}")
    if settings.profile.brackets > cycle:
        terminal.line(f"    ...   and so on in turn, {settings.profile.brackets} brackets in all")

    space = search_space(settings.profile.space, settings.agents, settings.seed)
    samples = space.sample_configuration(6)
    seconds, evaluations = [], []
    for i, sample in enumerate(samples):
        hp = to_hyperparameters(settings.base, dict(sample))
        architecture = Architecture.of(settings.task, hp.se)
        agent = hp.agents[i % len(hp.agents)]
        request = EvaluationRequest(0, i, agent, start_seed=i)
        if i == 0:
            evaluate(settings.task, architecture, None, request)  # compiles, untimed
        seconds.append(evaluate(settings.task, architecture, None, request).seconds)
        evaluations.append(hp.nes.evaluations)
    generations = generations_to_run(rungs)
    starts = sum(r.configurations for i, r in enumerate(rungs) if r.bracket != rungs[i - 1].bracket)
    estimate = Estimate(
        generations,
        round(generations * sum(evaluations) / len(evaluations))
        + starts * settings.base.nes.start_evaluations,
        sum(seconds) / len(seconds),
        trials * settings.workers_per_trial,
    )
    terminal.line(
        f"{estimate.generations} generations, {estimate.evaluations} evaluations of about "
        f"{estimate.seconds_per_evaluation:.2f}s: {duration(estimate.seconds)} on "
        f"{estimate.cores} core(s)"
    )
    if settings.profile.time_budget is not None:
        terminal.line(f"stopped by the time budget after {duration(settings.profile.time_budget)}")
    terminal.line(
        f"the cluster can place it: {trials} trial(s) at a time, "
        f"{settings.workers_per_trial} worker(s) each"
    )
