"""`bilevel bohb --dry-run`: the brackets of a study and their cost."""

from cluster.bohb.command import StudyCommand
from cluster.bohb.search.validation import validation_seconds
from cluster.bohb.study.brackets import Schedule, core_seconds_to_run, initial_configurations
from cluster.session.terminal import Terminal, count, duration
from cluster.storage.home import require_writable
from cluster.storage.run_folder import check_settings


def dry_run(command: StudyCommand) -> None:
    """Print the brackets, their cost, and whether the cluster can place the trials.

    Raises InvalidInput where the study would.
    """
    study = command.study
    study.prior_configuration()
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
        terminal.log(_cost(study.schedule, command.brackets, trials * command.workers_per_trial))
        if command.time_budget is not None:
            terminal.log(f"the time budget ends it after {duration(command.time_budget)}")
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


def _cost(schedule: Schedule, brackets: int, cores: int) -> str:
    """Describe the cost of search and validation, by budgets."""
    rungs = schedule.brackets(brackets)
    searched = core_seconds_to_run(rungs)
    validated = validation_seconds(searched)
    if validated < schedule.budgets[-1]:
        validated = 0.0  # too short for a validation
    return (
        f"{count(brackets, 'bracket')}: {initial_configurations(rungs)} configurations, {searched} "
        f"core seconds and {validated:.0f} of validation: about "
        f"{duration((searched + validated) / cores)} on {count(cores, 'core')}, depending on the "
        "speed of the cores"
    )
