"""The command `evaluate`."""

from pathlib import Path
from typing import Any

import click

from bilevel.errors import InvalidInput, one_of
from cluster.cli.options import (
    RunOptions,
    common_options,
    once,
    set_option,
    vary_option,
    workers_option,
)
from cluster.cli.parameters import WholeNumber
from cluster.cli.ses import GivenSE, SEAddress, load_se_of, task_option
from cluster.storage.home import LONGEST_NAME, plain_name


@click.command()
@click.argument("given", metavar="[SE]...", nargs=-1, type=SEAddress())
@click.option(
    "--real", metavar="TASK", help="Also train on this real task (gymnasium id), as the baseline."
)
@task_option
@click.option(
    "--agents",
    "count",
    type=WholeNumber(min=1),
    default=10,
    show_default=True,
    help="Fresh agents of each kind trained on each source.",
)
@vary_option
@set_option
@click.option(
    "--recipe",
    help="Recipe of the agents' hyperparameters: paper, authors, default, distilled or a file "
    "(default: the paper's table of default hyperparameters).",
)
@click.option(
    "--max-episodes",
    type=WholeNumber(min=1),
    help="Maximum number of training episodes (default: the recipe's).",
)
@workers_option
@click.option(
    "--name",
    help="Name of the evaluation and its folder; an existing name resumes (default: made of "
    "sources, agents and seed).",
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

    An SE is a file, the name of one of the zoo, or MLflow's address (runs:/..., models:/...).
    Several kinds (--agent ddqn,td3) are trained --agents times each.
    """
    from bilevel.hyperparameters import VARIATIONS, default_agents, load_recipe
    from bilevel.synthetic_env import StoredSE
    from search_spaces.translation import changed

    ses = _labelled(given)
    facts = (options["solved_reward"], options["step_limit"])
    if real is None and facts != (None, None):
        raise InvalidInput(
            "--solved-reward and --step-limit need --real: an SE file holds its own values"
        )
    # A task's module is imported before an SE of the task is read.
    on_real = None if real is None else RunOptions(task=real, **options).the_task()
    sources: dict[str, StoredSE | None] = {
        label: load_se_of(file, se_task) for label, file in ses.items()
    }
    tasks = {label: se.task() for label, se in sources.items() if se is not None}
    if on_real is not None:
        sources["real"], tasks["real"] = None, on_real
    task = next(iter(tasks.values()), None)
    if task is None:
        raise InvalidInput("nothing to train on: give SE files, or --real TASK")
    if len(set(tasks.values())) > 1:
        facts_of = sorted(
            f"{t.id} ({t.step_limit} steps, solved at {t.solved_reward:g})"
            for t in set(tasks.values())
        )
        raise InvalidInput(f"all sources must have the same task; got {', '.join(facts_of)}")
    if on_real is None:  # else it has been tried out
        task.try_out()
    common = RunOptions(task=task.id, recipe=recipe, **options)
    agents = common.the_agents()
    if recipe is None:
        kinds = default_agents(agents or ("ddqn",))
    else:
        kinds = load_recipe(recipe, task.id, agents).agents
    if max_episodes is not None:
        settings = (*((f"{hp.agent}.max_episodes", max_episodes) for hp in kinds), *settings)
    kinds = tuple(changed({hp.agent: hp for hp in kinds}, once(settings)).values())
    for hp in kinds:
        hp.require_learning()
    vary = vary or "no"
    if vary not in VARIATIONS:
        raise one_of("variation of agents", vary, VARIATIONS)
    varied = "" if vary == "no" else f"-{vary}"
    among = "-".join(hp.agent for hp in kinds)
    suffix = f"-{among}{varied}-seed{common.seed}"
    context = common.the_context()

    from cluster.evaluate.command import EvaluateCommand, run_evaluate

    run_evaluate(
        EvaluateCommand(
            task,
            sources,
            kinds,
            count,
            vary,
            common.seed,
            name or f"evaluate-{'-'.join(sources)}"[: LONGEST_NAME - len(suffix)] + suffix,
            context,
            workers,
        )
    )


def _labelled(given: tuple[GivenSE, ...]) -> dict[str, Path]:
    """The files by their labels in tables, names and metrics. Raises InvalidInput on duplicates."""
    found: dict[str, Path] = {}
    for se in given:
        label = plain_name(se.label)
        if label in found:
            label = plain_name(f"{se.path.resolve().parent.name}-{label}")
        if label in found or label == "real":
            raise InvalidInput(f"two sources are called {label!r}: rename {str(se.path)!r}")
        found[label] = se.path
    return found
