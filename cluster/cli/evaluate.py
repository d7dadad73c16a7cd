"""The command `evaluate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bilevel.errors import InvalidInput, unknown_value
from bilevel.tasks import Task
from cluster.cli.decorators import common_options, set_option, vary_option, workers_option
from cluster.cli.options import RunOptions, once
from cluster.cli.parameters import POSITIVE
from cluster.cli.ses import GivenSE, SEAddress, load_se_of, task_option
from cluster.storage.home import LONGEST_NAME, plain_name

if TYPE_CHECKING:
    from bilevel.hyperparameters import AgentHyperparameters
    from bilevel.synthetic_env import StoredSE


@click.command()
@click.argument("given", metavar="[SE]...", nargs=-1, type=SEAddress())
@click.option("--real", metavar="TASK", help="Also train on this real task, as the baseline.")
@task_option
@click.option(
    "--agents",
    "count",
    type=POSITIVE,
    default=10,
    show_default=True,
    help="Fresh agents of each kind trained on each source.",
)
@vary_option
@set_option
@click.option(
    "--recipe",
    help="Recipe of the agents' hyperparameters: paper, authors, default or a file (default: the "
    "paper's table of default hyperparameters).",
)
@click.option(
    "--max-episodes", type=POSITIVE, help="Training episodes at most (default: the recipe's)."
)
@workers_option
@click.option(
    "--name",
    help="Name of the evaluation and its folder; an existing name resumes (default: from sources, "
    "agents and seed).",
)
@common_options
def evaluate(
    given: tuple[GivenSE, ...],
    real: str | None,
    se_task: str | None,
    count: int,
    vary: str | None,
    settings: tuple[tuple[str, Any], ...],
    recipe: str | None,
    max_episodes: int | None,
    workers: int | None,
    name: str | None,
    **options: Any,
) -> None:
    """Train fresh agents on SEs (or on the real task) and test them on the real task.

    An SE is a file, a name in the zoo, or an address in MLflow (runs:/..., models:/...). Each of
    several kinds (--agent ddqn,td3) is trained --agents times.
    """
    from bilevel.hyperparameters import VARIATIONS

    task, sources = _sources(given, real, se_task, options)
    common = RunOptions(task=task.id, recipe=recipe, **options)
    kinds = _kinds(common, max_episodes, settings)
    vary = vary or "no"
    if vary not in VARIATIONS:
        raise unknown_value("variation of agents", vary, VARIATIONS)
    varied = "" if vary == "no" else f"-{vary}"
    suffix = f"-{'-'.join(hp.agent for hp in kinds)}{varied}-seed{common.seed}"
    name = name or f"evaluate-{'-'.join(sources)}"[: LONGEST_NAME - len(suffix)] + suffix
    context = common.the_context()

    from cluster.evaluate.command import EvaluateCommand, run_evaluate

    run_evaluate(
        EvaluateCommand(task, sources, kinds, count, vary, common.seed, name, context, workers)
    )


def _sources(
    given: tuple[GivenSE, ...], real: str | None, se_task: str | None, options: dict[str, Any]
) -> tuple[Task, dict[str, "StoredSE | None"]]:
    """Return the common task of all sources, and the SEs by label, None for the real task. Raises
    InvalidInput."""
    if real is None and (options["solved_reward"], options["step_limit"]) != (None, None):
        raise InvalidInput(
            "--solved-reward and --step-limit need --real: an SE file contains its own values"
        )
    # Import the task's module before reading an SE of the task.
    real_task = None if real is None else RunOptions(task=real, **options).the_task()
    sources: dict[str, StoredSE | None] = {
        label: load_se_of(file, se_task) for label, file in labelled(given).items()
    }
    tasks = {se.task() for se in sources.values() if se is not None}
    if real_task is not None:
        sources["real"] = None
        tasks.add(real_task)
    if not tasks:
        raise InvalidInput("nothing to train on: give SE files, or --real TASK")
    if len(tasks) > 1:
        described = sorted(
            f"{t.id} ({t.step_limit} steps, solved at {t.solved_reward:g})" for t in tasks
        )
        raise InvalidInput(f"all sources must have the same task; got {', '.join(described)}")
    (task,) = tasks
    if real_task is None:  # else already tried out
        task.try_out()
    return task, sources


def _kinds(
    common: RunOptions, max_episodes: int | None, settings: tuple[tuple[str, Any], ...]
) -> tuple["AgentHyperparameters", ...]:
    """Return the hyperparameters of each kind of agent. Raises InvalidInput."""
    from bilevel.hyperparameters import default_agents
    from bilevel.recipes import load_recipe
    from search_spaces.translation import changed

    names = common.the_agents()
    if common.recipe is None:
        kinds = default_agents(names or ("ddqn",))
    else:
        kinds = load_recipe(common.recipe, common.task, names).agents
    if max_episodes is not None:
        settings = (*((f"{hp.agent}.max_episodes", max_episodes) for hp in kinds), *settings)
    kinds = tuple(changed({hp.agent: hp for hp in kinds}, once(settings)).values())
    for hp in kinds:
        hp.require_learning()
    return kinds


def labelled(given: tuple[GivenSE, ...]) -> dict[str, Path]:
    """Return the files by their labels in tables, names and metrics. Equal labels get the name of
    their folder. Raises InvalidInput for equal labels in equal folders."""
    files: dict[str, Path] = {}
    for se in given:
        label = plain_name(se.label)
        if label in files:
            label = plain_name(f"{se.path.resolve().parent.name}-{label}")
        if label in files or label == "real":
            raise InvalidInput(f"two sources are called {label!r}: rename {str(se.path)!r}")
        files[label] = se.path
    return files
