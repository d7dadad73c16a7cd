"""Commands that run something: `nes` and `bohb`."""

import sys
from dataclasses import replace
from typing import Any

import click

from cluster.cli.options import (
    Duration,
    RunOptions,
    Setting,
    WholeNumber,
    agent_suffix,
    run_options,
    vary_option,
)


@click.command()
@run_options
@click.option("--preset", default=None, help="tuned (the paper's Table 1) or default.")
@click.option("--update", default="paired", show_default=True, help="NES update rule.")
@click.option("--generations", type=WholeNumber(min=1), help="At most; default 200.")
@click.option("--workers", type=WholeNumber(min=1), help="Actors; default all cores.")
@vary_option
@click.option("--start-candidates", type=WholeNumber(min=1), help="SEs to choose from.")
@click.option(
    "--set",
    "settings",
    type=Setting(),
    multiple=True,
    help="A hyperparameter, as nes.step_price=0.02 or ddqn.learning_rate=0.002; may be repeated.",
)
@click.option(
    "--solved-for",
    type=WholeNumber(min=1),
    default=2,
    show_default=True,
    help="Stop early once solved for so many generations in a row, and confirmed.",
)
@click.option("--name", help="Of the run; the same name goes on where it was.")
def nes(
    preset: str | None,
    update: str,
    generations: int | None,
    workers: int | None,
    vary: str | None,
    start_candidates: int | None,
    settings: tuple[tuple[str, Any], ...],
    solved_for: int,
    name: str | None,
    **options: Any,
) -> None:
    """One NES run on TASK (CartPole-v0, Acrobot-v1 or another gymnasium id)."""
    from bilevel.hyperparameters import best_preset, load_preset
    from search_spaces import to_hyperparameters

    common = RunOptions(**options)
    task = common.the_task()
    agents = common.the_agents()
    preset = preset or best_preset(task.id)
    hp = load_preset(preset, task.id, update, agents)
    changes: dict[str, Any] = {
        "population_size": common.population,
        "generations": generations,
        "start_candidates": start_candidates,
    }
    changed = {key: value for key, value in changes.items() if value is not None}
    hp = replace(hp, nes=replace(hp.nes, **changed), vary_agent=vary or hp.vary_agent)
    hp = to_hyperparameters(hp, dict(settings))
    if name is None:
        varied = "" if vary is None else f"-{vary}"
        name = f"nes-{preset}{agent_suffix(agents)}-{update}{varied}-seed{common.seed}"

    place = common.the_place()
    folder = place.home.run_folder(task.id, name)

    from cluster.nes_command import NESCommand, run_nes
    from cluster.nes_loop import NESRun

    run = NESRun(task, hp, common.seed, folder)
    run_nes(NESCommand(run, place, workers, solved_for))


@click.command()
@run_options
@click.option("--study", default=None, help="Name; the same name goes on where it was.")
@click.option("--profile", default="local", show_default=True, help="smoke, local or paper.")
@click.option("--space", help="full (the paper's 18 hyperparameters) or core.")
@click.option("--brackets", type=WholeNumber(min=1), help="Brackets to run.")
@click.option("--time-budget", type=Duration(), help="End after 90s, 45m, 2h, ...")
@click.option("--workers-per-trial", type=WholeNumber(min=1), default=1, show_default=True)
@click.option("--concurrent-trials", type=WholeNumber(min=1), help="Default: all cores' worth.")
@click.option(
    "--method",
    default="bohb",
    show_default=True,
    help="bohb; hyperband (the same brackets without BOHB's model); random (one configuration a "
    "bracket, to the largest budget).",
)
@click.option("--dry-run", is_flag=True, help="Say what would be run, and run nothing.")
def bohb(
    study: str | None,
    profile: str,
    space: str | None,
    brackets: int | None,
    time_budget: float | None,
    workers_per_trial: int,
    concurrent_trials: int | None,
    method: str,
    dry_run: bool,
    **options: Any,
) -> None:
    """BOHB over NES runs on TASK: tune NES, SE and agent hyperparameters."""
    from bilevel.errors import one_of
    from cluster.profiles import base_hyperparameters, get_method, get_profile
    from search_spaces import SPACES

    common = RunOptions(**options)
    task = common.the_task()
    agents = common.the_agents()
    get_method(method)
    size = get_profile(profile)
    if space is not None and space not in SPACES:
        raise one_of("search space", space, SPACES)
    changes: dict[str, Any] = {
        "space": space,
        "population": common.population,
        "brackets": brackets,
        "time_budget": time_budget,
    }
    size = replace(size, **{key: value for key, value in changes.items() if value is not None})
    place = common.the_place()
    name = study or f"{method}-{profile}-{size.space}{agent_suffix(agents)}-seed{common.seed}"
    folder = place.home.run_folder(task.id, name)

    from cluster.bohb.brackets import Schedule
    from cluster.bohb.command import StudyCommand, run_study
    from cluster.bohb.estimate import dry_run as estimate
    from cluster.bohb.study import Study

    schedule = Schedule.of(method, size.smallest_budget, size.largest_budget, size.cycle)
    command = StudyCommand(
        Study(
            folder,
            task,
            common.seed,
            size.space,
            schedule,
            base_hyperparameters(size, task, agents),
            method,
        ),
        place,
        size.brackets,
        size.time_budget,
        size.final_agents,
        workers_per_trial,
        concurrent_trials,
    )
    if dry_run:
        estimate(command)
    else:
        sys.exit(run_study(command))
