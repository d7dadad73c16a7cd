"""`bilevel bohb --dry-run`: what a study would run, and what that would cost."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bilevel.evaluation import EvaluationRequest, evaluate
from bilevel.synthetic_env import Architecture
from bilevel.synthetic_env.fitted import fitted_psi
from cluster.bohb.brackets import Rung, bracket_table, generations_to_run
from cluster.bohb.command import StudyCommand
from cluster.progress import duration
from cluster.ray_cluster import require_capacity
from search_spaces import draw_agent, search_space, to_hyperparameters

#: Configurations of which an evaluation is timed.
_SAMPLES = 6


@dataclass(frozen=True)
class Estimate:
    """What a study would cost; for `--dry-run`."""

    generations: int
    evaluations: int
    seconds_per_evaluation: float
    fits: int
    seconds_per_fit: float
    trials: int  # at a time; each fits on one core
    cores: int

    @property
    def seconds(self) -> float:
        """Time on the cluster's cores."""
        evaluating = self.evaluations * self.seconds_per_evaluation / self.cores
        return evaluating + self.fits * self.seconds_per_fit / self.trials

    def __str__(self) -> str:
        fits = f"{self.fits} fits of about {self.seconds_per_fit:.0f}s, " if self.fits else ""
        return (
            f"{self.generations} generations, {fits}{self.evaluations} evaluations of about "
            f"{self.seconds_per_evaluation:.2f}s: {duration(self.seconds)} on {self.cores} core(s)"
        )


def dry_run(command: StudyCommand) -> None:
    """Print the bracket table, the cost, and whether the cluster can place it.

    The time is estimated from evaluations of randomly drawn configurations, and from a
    fit, made here and now on one core. Raises InvalidInput where the study itself would.
    """
    study = command.study
    rungs = bracket_table(command.brackets, list(study.budgets))
    with command.place.entered() as terminal:
        trials = command.trials
        require_capacity(command.workers_per_trial, trials)
    terminal.line(
        f"{study.method} on {study.task.id}: study {study.name!r}, budgets in generations"
    )
    terminal.line("bracket   configurations x budget")
    cycle = len(study.budgets)
    for bracket in range(min(command.brackets, cycle)):
        row = " -> ".join(
            f"{rung.configurations} x {rung.budget}" for rung in rungs if rung.bracket == bracket
        )
        terminal.line(f"{bracket:7d}   {row}")
    if command.brackets > cycle:
        terminal.line(f"    ...   and so on in turn, {command.brackets} brackets in all")

    estimate = _estimate(command, generations_to_run(rungs), _starts(rungs), trials)
    terminal.line(str(estimate))
    if command.time_budget is not None:
        terminal.line(f"stopped by the time budget after {duration(command.time_budget)}")
    terminal.line(
        f"the cluster can place it: {trials} trial(s) at a time, "
        f"{command.workers_per_trial} worker(s) each"
    )


def _starts(rungs: Sequence[Rung]) -> int:
    """Configurations of the table; the others go on with these."""
    return sum(r.configurations for i, r in enumerate(rungs) if r.bracket != rungs[i - 1].bracket)


def _estimate(command: StudyCommand, generations: int, starts: int, trials: int) -> Estimate:
    study = command.study
    nes, shape = study.base.nes, Architecture.of(study.task, study.base.se)
    psi, seconds_per_fit = shape.initialize(np.random.default_rng(study.seed)), 0.0
    if nes.start == "fitted":
        began = time.perf_counter()
        psi = fitted_psi(study.task, shape, study.seed)
        seconds_per_fit = time.perf_counter() - began
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
        generations,
        round(generations * sum(evaluations) / len(evaluations)) + starts * nes.start_evaluations,
        sum(seconds) / len(seconds),
        starts * nes.start_candidates if nes.start == "fitted" else 0,
        seconds_per_fit,
        trials,
        trials * command.workers_per_trial,
    )
