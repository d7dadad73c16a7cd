"""`bilevel bohb --dry-run`: what a study would run, and what that would cost."""

import math
import time
from bisect import bisect_right
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, evaluate
from bilevel.synthetic_env import Architecture
from bilevel.synthetic_env.fitted import fitted_psi
from cluster.bohb.brackets import Schedule, configurations_to_begin, generations_to_run
from cluster.bohb.command import StudyCommand
from cluster.bohb.study import Study
from cluster.final import RETEST, agents_needed
from cluster.progress import count, duration
from cluster.ray_cluster import require_capacity
from search_spaces import draw_agent, search_space, to_hyperparameters

#: Configurations of which an evaluation is timed.
_SAMPLES = 6


@dataclass(frozen=True)
class Estimate:
    """What a study would cost; for `--dry-run`."""

    schedule: Schedule
    brackets: int
    evaluations_per_generation: float
    seconds_per_evaluation: float
    starts: int  # fitted, of which one is chosen before the first trial
    seconds_per_start: float
    seconds_per_fit: float  # of each configuration's networks to the same steps
    trials: int  # at a time; each records once what it fits to, and fits on one core
    cores: int

    @property
    def generations(self) -> int:
        """Of all configurations."""
        return generations_to_run(self.schedule.brackets(self.brackets))

    @property
    def evaluations(self) -> int:
        """The tests of starts included."""
        evaluations = round(self.generations * self.evaluations_per_generation)
        return evaluations + (agents_needed(self.starts, RETEST) if self.starts else 0)

    @property
    def seconds(self) -> float:
        """Time on the cluster's cores."""
        evaluating = self.evaluations * self.seconds_per_evaluation / self.cores
        if not self.starts:
            return evaluating
        starting = (math.ceil(self.starts / self.cores) + 1) * self.seconds_per_start
        configurations = configurations_to_begin(self.schedule.brackets(self.brackets))
        return evaluating + starting + configurations * self.seconds_per_fit / self.trials

    def within(self, seconds: float) -> Self:
        """Of as many brackets as that time holds, one at least."""
        brackets = bisect_right(
            range(1, self.brackets + 1),
            seconds,
            key=lambda number: replace(self, brackets=number).seconds,
        )
        return replace(self, brackets=max(brackets, 1))

    def __str__(self) -> str:
        fits = (
            f"{self.starts} fitted starts of about {self.seconds_per_start:.0f}s, "
            if self.starts
            else ""
        )
        return (
            f"{count(self.brackets, 'bracket')}: {self.generations} generations, {fits}"
            f"{self.evaluations} evaluations of about {self.seconds_per_evaluation:.2f}s: "
            f"{duration(self.seconds)} on {self.cores} core(s)"
        )


def dry_run(command: StudyCommand) -> None:
    """Print the bracket table, the cost, and whether the cluster can place it.

    The time is estimated from evaluations of randomly drawn configurations, and from a
    fit, made here and now on one core. Raises InvalidInput where the study itself would.
    """
    study, schedule = command.study, command.study.schedule
    with command.place.entered() as terminal:
        trials = command.trials
        require_capacity(command.workers_per_trial, trials)
    terminal.line(
        f"{study.method_name} on {study.task.id}: study {study.name!r}, budgets in generations"
    )
    terminal.line("bracket   configurations x budget")
    for bracket in range(min(command.brackets, schedule.cycle)):
        rungs = schedule.bracket(bracket)
        row = " -> ".join(f"{rung.configurations} x {rung.budget}" for rung in rungs)
        terminal.line(f"{bracket:7d}   {row}")
    if command.brackets > schedule.cycle:
        terminal.line("    ...   and so on")

    estimate = _estimate(command, trials)
    if command.time_budget is not None and estimate.seconds > command.time_budget:
        estimate = estimate.within(command.time_budget)
        terminal.line(f"the time budget of {duration(command.time_budget)} is enough for about")
    terminal.line(str(estimate))
    terminal.line(
        f"the cluster can place it: {trials} trial(s) at a time, "
        f"{command.workers_per_trial} worker(s) each"
    )


def _estimate(command: StudyCommand, trials: int) -> Estimate:
    study = command.study
    starts = len(study.start_seeds) if study.fitted else 0
    shape = Architecture.of(study.task, study.base.se)
    psi = shape.initialize(np.random.default_rng(study.seed))
    seconds_per_start = seconds_per_fit = 0.0
    if starts:
        psi, seconds_per_start = _timed_fit(study)
        _, seconds_per_fit = _timed_fit(study)
    samples = search_space(study.space, study.agents, study.seed).sample_configuration(_SAMPLES)
    seconds, evaluations = [], []
    for i, sample in enumerate(samples):
        hp = to_hyperparameters(study.base, dict(sample))
        # The psi is of the base's networks; how long episodes are matters more.
        limited = replace(shape, step_limit_share=hp.se.step_limit_share)
        request = EvaluationRequest(0, i, draw_agent(hp.agents, hp.vary_agent, i))
        if i == 0:
            evaluate(study.task, limited, psi, request)  # compiles, untimed
        seconds.append(evaluate(study.task, limited, psi, request).seconds)
        evaluations.append(hp.nes.evaluations)
    return Estimate(
        study.schedule,
        command.brackets,
        sum(evaluations) / len(evaluations),
        sum(seconds) / len(seconds),
        starts,
        seconds_per_start,
        seconds_per_fit,
        trials,
        trials * command.workers_per_trial,
    )


def _timed_fit(study: Study) -> tuple[NDArray[np.float32], float]:
    """psi (P,), and seconds; the second time without what fits have in common."""
    began = time.perf_counter()
    psi = fitted_psi(study.task, Architecture.of(study.task, study.base.se), study.seed)
    return psi, time.perf_counter() - began
