"""`bilevel bohb --dry-run`: the brackets of a study and their estimated time."""

from bisect import bisect_right
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Self

from loky import cpu_count

from bilevel.agents import get_agent
from bilevel.evaluation import evaluate
from bilevel.nes import NES
from cluster.bohb.command import StudyCommand
from cluster.bohb.search.validation import validation_seconds
from cluster.bohb.study.brackets import Schedule, configurations_to_begin, core_seconds_to_run
from cluster.session.terminal import Terminal, count, duration
from cluster.storage.home import require_writable
from cluster.storage.run_folder import check_settings
from search_spaces.translation import to_hyperparameters

#: Random configurations, and the evaluations of each, that are timed.
_SAMPLES, _EVALUATIONS = 6, 8


@dataclass(frozen=True)
class Estimate:
    """Estimated time of a study."""

    schedule: Schedule
    brackets: int
    speed: float  # seconds that a core of this machine takes for a core second of a budget
    cores: int

    @property
    def searched(self) -> int:
        """Core seconds of all configurations, by their budgets."""
        return core_seconds_to_run(self.schedule.brackets(self.brackets))

    @property
    def validated(self) -> int:
        """Core seconds of the validation; 0 for a search that is too short for one."""
        seconds = validation_seconds(self.searched)
        return round(seconds) if seconds >= self.schedule.budgets[-1] else 0

    @property
    def configurations(self) -> int:
        """Number of configurations that are begun."""
        return configurations_to_begin(self.schedule.brackets(self.brackets))

    @property
    def seconds(self) -> float:
        """Wall-clock seconds on all cores."""
        return (self.searched + self.validated) * self.speed / self.cores

    def within(self, seconds: float) -> Self:
        """The estimate for as many brackets as fit into `seconds`, at least one."""
        brackets = bisect_right(
            range(1, self.brackets + 1),
            seconds,
            key=lambda number: replace(self, brackets=number).seconds,
        )
        return replace(self, brackets=max(brackets, 1))

    def __str__(self) -> str:
        validation = " (too few for a validation)"
        if self.validated:
            validation = f" and {self.validated} of validation"
        return (
            f"{count(self.brackets, 'bracket')}: {self.configurations} configurations, "
            f"{self.searched} core seconds{validation}: "
            f"{duration(self.seconds)} on {count(self.cores, 'core')}, where a core second takes "
            f"{self.speed:.2f} s"
        )


def dry_run(command: StudyCommand) -> None:
    """Print the bracket table, the cost, and whether the cluster can place it.

    The time is estimated from a few evaluations of random configurations, measured on this machine
    with as many cores busy as the study would use. Raises InvalidInput where the study itself
    would.
    """
    require_writable(command.context.home.folder)
    check_settings(command.study.folder, command.study.settings())
    capacity = command.context.capacity()
    command = command.placed(capacity)
    trials = command.trials_on(capacity)
    capacity.require(command.workers_per_trial, trials)
    with Terminal() as terminal:
        _print_estimate(command, trials, terminal)


def _print_estimate(command: StudyCommand, trials: int, terminal: Terminal) -> None:
    study, schedule = command.study, command.study.schedule
    terminal.log(
        f"{study.method_name} on {study.task.id}: study {study.name!r}, prior {study.prior}, "
        "budgets in core seconds"
    )
    terminal.log("bracket   configurations x budget")
    for bracket in range(min(command.brackets, schedule.cycle)):
        rungs = schedule.bracket(bracket)
        row = " -> ".join(f"{rung.configurations} x {rung.budget}" for rung in rungs)
        terminal.log(f"{bracket:7d}   {row}")
    if command.brackets > schedule.cycle:
        terminal.log("    ...   and so on")

    estimate = _estimate(command, trials, terminal)
    if command.time_budget is not None and estimate.seconds > command.time_budget:
        estimate, budget = estimate.within(command.time_budget), duration(command.time_budget)
        enough = estimate.seconds <= command.time_budget
        terminal.log(
            f"the time budget of {budget} is enough for about"
            if enough
            else f"the time budget of {budget} is not enough for one bracket:"
        )
    terminal.log(str(estimate))
    terminal.log(
        f"the cluster can place it: {count(trials, 'trial')} at a time, "
        f"{count(command.workers_per_trial, 'worker')} each"
    )


def _estimate(command: StudyCommand, trials: int, terminal: Terminal) -> Estimate:
    study, cores = command.study, trials * command.workers_per_trial
    samples = study.space.build(study.agents, study.seed % 2**32).sample_configuration(_SAMPLES)
    jobs = []
    for number, sample in enumerate(samples):
        nes = NES(study.task, to_hyperparameters(study.base, dict(sample)), number)
        state = nes.init()
        jobs += [(state.se, request) for request in nes.ask(state)[:_EVALUATIONS]]
    terminal.bar("timing", 0, len(jobs), "evaluations")
    evaluate(study.task, *jobs[0])  # loads the kernels, untimed
    results = []
    with ThreadPoolExecutor(_busy(study.agents, cores)) as pool:
        for result in pool.map(lambda job: evaluate(study.task, *job), jobs):
            results.append(result)
            terminal.bar("timing", len(results), len(jobs), "evaluations")
    seconds = sum(result.seconds for result in results)
    cost = sum(result.cost for result in results)
    return Estimate(study.schedule, command.brackets, seconds / max(cost, 1e-9), cores)


def _busy(agents: Sequence[str], cores: int) -> int:
    """Number of evaluations that are timed at once: cores share caches, memory and frequency, so
    that each is slower while others work. Compiled agents release Python's lock; others would only
    wait for each other."""
    compiled = all(get_agent(agent).build_kernel is not None for agent in agents)
    return min(cores, cpu_count()) if compiled else 1
