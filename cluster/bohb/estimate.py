"""`bilevel bohb --dry-run`: what a study would run, and what that would cost."""

from dataclasses import dataclass

from bilevel.evaluation import EvaluationRequest, evaluate
from bilevel.synthetic_env import Architecture
from cluster.bohb.brackets import bracket_table, generations_to_run
from cluster.bohb.command import StudyCommand
from cluster.progress import duration
from cluster.ray_cluster import require_capacity
from search_spaces import search_space, to_hyperparameters


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


def dry_run(command: StudyCommand) -> None:
    """Print the bracket table, the cost, and whether the cluster can place it.

    The time is estimated from evaluations of randomly drawn configurations, made
    here and now on one core. Raises InvalidInput where the study itself would.
    """
    study = command.study
    rungs = bracket_table(command.brackets, list(study.budgets))
    with command.place.entered() as terminal:
        trials = command.trials
        require_capacity(command.workers_per_trial, trials)
    terminal.line(f"study {study.name!r} on {study.task.id}, budgets in generations")
    terminal.line("bracket   configurations x budget")
    cycle = len(study.budgets)
    for bracket in range(min(command.brackets, cycle)):
        row = " -> ".join(
            f"{rung.configurations} x {rung.budget}" for rung in rungs if rung.bracket == bracket
        )
        terminal.line(f"{bracket:7d}   {row}")
    if command.brackets > cycle:
        terminal.line(f"    ...   and so on in turn, {command.brackets} brackets in all")

    samples = search_space(study.space, study.agents, study.seed).sample_configuration(6)
    seconds, evaluations = [], []
    for i, sample in enumerate(samples):
        hp = to_hyperparameters(study.base, dict(sample))
        architecture = Architecture.of(study.task, hp.se)
        agent = hp.agents[i % len(hp.agents)]
        request = EvaluationRequest(0, i, agent, start_seed=i)
        if i == 0:
            evaluate(study.task, architecture, None, request)  # compiles, untimed
        seconds.append(evaluate(study.task, architecture, None, request).seconds)
        evaluations.append(hp.nes.evaluations)
    generations = generations_to_run(rungs)
    starts = sum(r.configurations for i, r in enumerate(rungs) if r.bracket != rungs[i - 1].bracket)
    estimate = Estimate(
        generations,
        round(generations * sum(evaluations) / len(evaluations))
        + starts * study.base.nes.start_evaluations,
        sum(seconds) / len(seconds),
        trials * command.workers_per_trial,
    )
    terminal.line(
        f"{estimate.generations} generations, {estimate.evaluations} evaluations of about "
        f"{estimate.seconds_per_evaluation:.2f}s: {duration(estimate.seconds)} on "
        f"{estimate.cores} core(s)"
    )
    if command.time_budget is not None:
        terminal.line(f"stopped by the time budget after {duration(command.time_budget)}")
    terminal.line(
        f"the cluster can place it: {trials} trial(s) at a time, "
        f"{command.workers_per_trial} worker(s) each"
    )
