"""The commands `nes` and `bohb`."""

import sys
from dataclasses import replace
from typing import Any

import click

from cluster.cli.options import POSITIVE, run_options, seconds, workers_option
from cluster.cli.run_options import RunOptions, the_context
from cluster.storage.home import plain_name


@click.command()
@run_options
@click.option("--generations", type=POSITIVE, help="Maximum number.")
@workers_option
@click.option(
    "--solved-for",
    type=POSITIVE,
    help="Stop once the mean of this many generations solves the task and fresh agents confirm it.",
)
@click.option("--name", help="Name of the run and its folder; an existing name resumes.")
def nes(
    generations: int | None,
    workers: int | None,
    solved_for: int | None,
    name: str | None,
    **options: Any,
) -> None:
    """Learn an SE for TASK (CartPole-v0, Acrobot-v1 or another gymnasium id) by one NES run.

    The options default to the values of the recipe and the task.
    """
    from bilevel.hyperparameters import CONFIRMING_AGENTS

    common = RunOptions(**options)
    task = common.the_task(timed=True)
    hp = common.the_hyperparameters(task, generations=generations, solved_for=solved_for)
    # Recipes that never stop early have no confirming agents.
    if solved_for and "nes.confirming_agents" not in common.replaced:
        confirming = hp.nes.confirming_agents or CONFIRMING_AGENTS
        hp = replace(hp, nes=replace(hp.nes, confirming_agents=confirming))
    name = name or plain_name(f"nes{common.suffix(hp.recipe)}-seed{common.seed}")
    context = the_context(**options)
    folder = context.home.run_folder(task.id, name)

    from cluster.nes.command import run_nes
    from cluster.nes.run import NESRun

    task = common.resumed(task, folder)
    run_nes(NESRun(task, hp, common.seed, folder), context, workers)


@click.command()
@run_options
@click.option("--study", help="Name of the study and its folder; an existing name resumes.")
@click.option(
    "--profile",
    type=click.Choice(["smoke", "local", "paper"]),
    default="local",
    show_default=True,
    help="Size of the search: smoke, local (30 minutes) or paper.",
)
@click.option(
    "--space",
    help="Search space: full (the paper's 18 hyperparameters), core (eight of NES and the SE), or "
    "a file of ConfigSpace, *.json.",
)
@click.option("--brackets", type=click.IntRange(1, 1000), help="Number of brackets.")
@click.option(
    "--time-budget",
    type=seconds,
    metavar="DURATION",
    help="Time limit of this call: 90s, 45m, 2h or seconds.",
)
@click.option(
    "--workers-per-trial", type=POSITIVE, help="Actors (default: 1, or more on a large cluster)."
)
@click.option(
    "--concurrent-trials", type=POSITIVE, help="Number (default: all that fit into the cluster)."
)
@click.option(
    "--method",
    type=click.Choice(["bohb", "hyperband", "random"]),
    default="bohb",
    show_default=True,
    help="hyperband runs brackets without a model, random searches at the largest budget.",
)
@click.option(
    "--prior",
    type=click.Choice(["none", "recipe"]),
    help="recipe draws about half of the random configurations around the recipe's.",
)
@click.option("--dry-run", is_flag=True, help="Only print brackets, cost and estimated time.")
def bohb(
    study: str | None,
    profile: str,
    workers_per_trial: int | None,
    concurrent_trials: int | None,
    method: str,
    dry_run: bool,
    **options: Any,
) -> None:
    """BOHB over NES runs on TASK: tune NES, SE and agent hyperparameters.

    The options default to the values of the profile.
    """
    from cluster.bohb.study.profiles import PROFILES, searched_space, sized
    from search_spaces.space import Space

    changes = {name: options.pop(name) for name in ("space", "brackets", "time_budget", "prior")}
    common = RunOptions(**options)
    task = common.the_task(timed=True)
    size = replace(
        PROFILES[profile], **{name: value for name, value in changes.items() if value is not None}
    )
    hp = common.the_hyperparameters(task, size.recipe, lambda recipe: sized(recipe, size))
    searched = searched_space(Space.of(size.space), task, hp, common.replaced, size.prior)
    context = the_context(**options)
    default = f"{method}-{profile}-{searched.name}{common.suffix(hp.recipe)}-seed{common.seed}"
    folder = context.home.run_folder(task.id, study or plain_name(default))

    from cluster.bohb.command import StudyCommand, estimate, run_study
    from cluster.bohb.study.brackets import Schedule
    from cluster.bohb.study.definition import Study

    task = common.resumed(task, folder)
    schedule = Schedule.of(method, size.smallest_budget, size.largest_budget, size.cycle)
    defined = Study(folder, task, common.seed, searched, schedule, hp, method, size.prior)
    command = StudyCommand(defined, context, size, workers_per_trial or 0, concurrent_trials)
    if dry_run:
        estimate(command)
    else:
        sys.exit(run_study(command))
