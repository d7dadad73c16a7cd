"""`bilevel bohb --dry-run`: the brackets of a study and their estimated cost."""

from bisect import bisect_right
from dataclasses import dataclass, replace
from typing import Self

from bilevel.evaluation import evaluate
from bilevel.nes import NES
from cluster.bohb.brackets import Schedule, configurations_to_begin, generations_to_run
from cluster.bohb.command import StudyCommand
from cluster.session.terminal import Terminal, count, duration
from search_spaces import to_hyperparameters

#: Configurations whose evaluations are timed.
_SAMPLES = 6


@dataclass(frozen=True)
class Estimate:
    """Estimated cost of a study."""

    schedule: Schedule
    brackets: int
    evaluations_per_generation: float
    seconds_per_evaluation: float
    start_evaluations: int  # per configuration, to choose its start
    cores: int

    @property
    def generations(self) -> int:
        """Generations of all configurations."""
        return generations_to_run(self.schedule.brackets(self.brackets))

    @property
    def evaluations(self) -> int:
        """Evaluations of all configurations, including the choice of their starts."""
        begun = configurations_to_begin(self.schedule.brackets(self.brackets))
        generations = round(self.generations * self.evaluations_per_generation)
        return generations + begun * self.start_evaluations

    @property
    def seconds(self) -> float:
        """Wall-clock seconds on all cores."""
        return self.evaluations * self.seconds_per_evaluation / self.cores

    def within(self, seconds: float) -> Self:
        """The estimate for as many brackets as fit into `seconds`, at least one."""
        brackets = bisect_right(
            range(1, self.brackets + 1),
            seconds,
            key=lambda number: replace(self, brackets=number).seconds,
        )
        return replace(self, brackets=max(brackets, 1))

    def __str__(self) -> str:
        return (
            f"{count(self.brackets, 'bracket')}: {self.generations} generations, "
            f"{self.evaluations} evaluations of about {self.seconds_per_evaluation:.3f}s: "
            f"{duration(self.seconds)} on {self.cores} core(s)"
        )


def dry_run(command: StudyCommand) -> None:
    """Print the bracket table, the cost, and whether the cluster can place it.

    The time is estimated from a few evaluations of random configurations on one core. Raises
    InvalidInput where the study itself would.
    """
    capacity = command.context.capacity()
    command = command.placed(capacity)
    trials = command.trials_on(capacity)
    capacity.require(command.workers_per_trial, trials)
    with Terminal() as terminal:
        _print_estimate(command, trials, terminal)


def _print_estimate(command: StudyCommand, trials: int, terminal: Terminal) -> None:
    study, schedule = command.study, command.study.schedule
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
    samples = study.space.build(study.agents, study.seed).sample_configuration(_SAMPLES)
    seconds, evaluations = [], []
    race = 0
    for number, sample in enumerate(samples):
        nes = NES(study.task, to_hyperparameters(study.base, dict(sample)), number)
        state = nes.init()
        if state.race is not None:
            race = state.race.evaluations
        requests = nes.ask(state)
        if number == 0:
            evaluate(study.task, state.se, requests[0])  # compiles, untimed
        seconds += [evaluate(study.task, state.se, request).seconds for request in requests[:8]]
        evaluations.append(nes.hp.nes.evaluations)
    return Estimate(
        study.schedule,
        command.brackets,
        sum(evaluations) / len(evaluations),
        sum(seconds) / len(seconds),
        race,
        trials * command.workers_per_trial,
    )
