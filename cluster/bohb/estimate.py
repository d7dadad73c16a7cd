"""`bilevel bohb --dry-run`: the brackets of a study and their estimated time."""

from bisect import bisect_right
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Self

from loky import cpu_count

from bilevel.agents import get_agent
from bilevel.evaluation import evaluate
from bilevel.nes import NES
from cluster.bohb.command import StudyCommand
from cluster.bohb.search.validation import validation_seconds
from cluster.bohb.study.brackets import Schedule, core_seconds_to_run, initial_configurations
from cluster.bohb.study.definition import Study
from cluster.bohb.study.prior import check_prior
from cluster.session.terminal import Terminal, count, duration
from cluster.storage.home import require_writable
from cluster.storage.run_folder import check_settings
from search_spaces.translation import to_hyperparameters

#: Random configurations, and evaluations of each, that are timed.
_SAMPLES, _EVALUATIONS = 6, 8


@dataclass(frozen=True)
class Estimate:
    """Estimated time of a study."""

    schedule: Schedule
    brackets: int
    speed: float  # measured seconds of an estimated core second
    cores: int

    @property
    def core_seconds(self) -> tuple[int, int]:
        """Core seconds of search and validation, by budgets. Short searches have no validation."""
        searched = core_seconds_to_run(self.schedule.brackets(self.brackets))
        validated = round(validation_seconds(searched))
        return searched, validated if validated >= self.schedule.budgets[-1] else 0

    @property
    def seconds(self) -> float:
        """Elapsed seconds on all cores."""
        return sum(self.core_seconds) * self.speed / self.cores

    def within(self, seconds: float) -> Self:
        """Return the estimate for the brackets that fit into `seconds`, at least one."""
        numbers = range(1, self.brackets + 1)
        fit = bisect_right(numbers, seconds, key=lambda n: replace(self, brackets=n).seconds)
        return replace(self, brackets=max(fit, 1))

    def __str__(self) -> str:
        configurations = initial_configurations(self.schedule.brackets(self.brackets))
        searched, validated = self.core_seconds
        return (
            f"{count(self.brackets, 'bracket')}: {configurations} configurations, "
            f"{searched} core seconds"
            f"{f' and {validated} of validation' if validated else ' (too few for a validation)'}: "
            f"{duration(self.seconds)} on {count(self.cores, 'core')}, where a core second takes "
            f"{self.speed:.2f} s"
        )


def dry_run(command: StudyCommand) -> None:
    """Print the brackets, the estimated time, and whether the cluster can place the trials.

    Raises InvalidInput where the study would.
    """
    study, budget = command.study, command.time_budget
    check_prior(study)
    require_writable(command.context.home.folder)
    check_settings(study.folder, study.settings())
    capacity = command.context.capacity()
    command = command.placed(capacity)
    trials = command.trials_on(capacity)
    capacity.require(command.workers_per_trial, trials)
    with Terminal() as terminal:
        terminal.log(
            f"{study.method_name} on {study.task.id}: study {study.name!r}, prior {study.prior}, "
            "budgets in core seconds"
        )
        _print_brackets(study.schedule, command.brackets, terminal)
        cores = trials * command.workers_per_trial
        speed = measured_speed(study, cores, terminal)
        estimate = Estimate(study.schedule, command.brackets, speed, cores)
        if budget is not None and estimate.seconds > budget:
            estimate = estimate.within(budget)
            enough = estimate.seconds <= budget
            fits = "is enough for about" if enough else "is not enough for one bracket:"
            terminal.log(f"the time budget of {duration(budget)} {fits}")
        terminal.log(str(estimate))
        terminal.log(
            f"the cluster can place it: {count(trials, 'trial')} at a time, "
            f"{count(command.workers_per_trial, 'worker')} each"
        )


def _print_brackets(schedule: Schedule, brackets: int, terminal: Terminal) -> None:
    terminal.log("bracket   configurations x budget")
    for bracket in range(min(brackets, schedule.cycle)):
        rungs = schedule.bracket(bracket)
        row = " -> ".join(f"{rung.configurations} x {rung.budget}" for rung in rungs)
        terminal.log(f"{bracket:7d}   {row}")
    if brackets > schedule.cycle:
        terminal.log("    ...   and so on")


def measured_speed(study: Study, cores: int, terminal: Terminal) -> float:
    """Return the measured seconds of an estimated core second, from evaluations of random
    configurations on the cores that the study would use."""
    samples = study.space.build(study.agents, study.seed % 2**32).sample_configuration(_SAMPLES)
    jobs = []
    for number, sample in enumerate(samples):
        nes = NES(study.task, to_hyperparameters(study.base, dict(sample)), number)
        state = nes.init()
        ses = nes.distribution(state)
        jobs += [(ses, request) for request in nes.ask(state)[:_EVALUATIONS]]
    terminal.bar("timing", 0, len(jobs), "evaluations")
    evaluate(study.task, *jobs[0])  # compiles or loads the kernels, untimed
    # Only compiled agents release Python's lock.
    compiled = all(get_agent(agent).build_kernel is not None for agent in study.agents)
    results = []
    with ThreadPoolExecutor(min(cores, cpu_count()) if compiled else 1) as pool:
        for result in pool.map(lambda job: evaluate(study.task, *job), jobs):
            results.append(result)
            terminal.step()
    cost = sum(result.cost for result in results)
    return sum(result.seconds for result in results) / max(cost, 1e-9)
