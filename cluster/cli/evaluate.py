"""The commands `evaluate` and `experiment`: fresh agents on SEs and on the real task."""

from typing import TYPE_CHECKING, Any

import click

from bilevel.errors import InvalidInput
from bilevel.tasks import Task
from cluster.cli.options import POSITIVE, common_options, hp_options, task_option, workers_option
from cluster.cli.run_options import RunOptions, the_context
from cluster.cli.ses import given_se, load_se_of
from cluster.storage.home import LONGEST_NAME, plain_name

if TYPE_CHECKING:
    from bilevel.synthetic_env import StoredSE


@click.command()
@click.argument("given", metavar="[SE]...", nargs=-1)
@click.option("--real", metavar="TASK", help="Also train on this real task, as the baseline.")
@task_option
@click.option(
    "--agents", "count", type=POSITIVE, default=10, help="Agents per kind and source (default: 10)."
)
@hp_options
@click.option(
    "--recipe", help="Recipe of the agents (default: the paper's table of default hyperparameters)."
)
@click.option("--max-episodes", type=POSITIVE, help="Maximum number of training episodes.")
@workers_option
@click.option("--name", help="Name of the evaluation and its folder; an existing name resumes.")
@common_options
def evaluate(
    given: tuple[str, ...],
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
    from bilevel.agents import get_agent
    from bilevel.recipes import load_recipe, usual_agents
    from search_spaces.translation import changed

    task, sources = _sources(given, real, se_task, options)
    common = RunOptions(task=task.id, recipe=recipe, **options)
    names = common.the_agents()
    agents = {}
    for label, se in sources.items():
        one_step = se is not None and se.se.architecture.one_step
        kinds = usual_agents(task, one_step, names)
        if recipe is not None:
            kinds = load_recipe(recipe, task, names).agents
        own = {f"{hp.agent}.max_episodes": max_episodes for hp in kinds if max_episodes is not None}
        agents[label] = tuple(
            changed({hp.agent: hp for hp in kinds}, own | dict(settings)).values()
        )
        for hp in agents[label]:
            hp.require_learning()
            get_agent(hp.agent, task.continuous)
    vary = vary or "no"
    varied = "" if vary == "no" else f"-{vary}"
    suffix = f"-{'-'.join(hp.agent for hp in kinds)}{varied}-seed{common.seed}"
    name = name or f"evaluate-{'-'.join(sources)}"[: LONGEST_NAME - len(suffix)] + suffix
    context = the_context(**options)

    from cluster.evaluate.command import EvaluateCommand, run_evaluate

    run_evaluate(
        EvaluateCommand(task, sources, agents, count, vary, common.seed, name, context, workers)
    )


def _sources(
    given: tuple[str, ...], real: str | None, se_task: str | None, options: dict[str, Any]
) -> tuple[Task, dict[str, "StoredSE | None"]]:
    """Return the common task of all sources, and the SEs by label, None for the real task. Raises
    InvalidInput."""
    if real is None and (options["solved_reward"], options["step_limit"]) != (None, None):
        raise InvalidInput(
            "--solved-reward and --step-limit need --real: an SE file contains its own values"
        )
    # Import the task's module before reading an SE of the task.
    tasks = [] if real is None else [RunOptions(task=real, **options).the_task()]
    sources: dict[str, StoredSE | None] = {}
    for address in given:
        path, label = given_se(address, options["home"], options["tracking_uri"])
        label = plain_name(label)
        if label in (*sources, "real"):
            raise InvalidInput(f"two sources are called {label!r}: rename {str(path)!r}")
        stored = sources[label] = load_se_of(path, se_task)
        tasks.append(stored.task())
    if real is not None:
        sources["real"] = None
    if not tasks:
        raise InvalidInput("nothing to train on: give SE files, or --real TASK")
    if len(set(tasks)) > 1:
        described = sorted(
            f"{t.id} ({t.step_limit} steps, solved at {t.solved_reward:g})" for t in {*tasks}
        )
        raise InvalidInput(f"all sources must have the same task; got {', '.join(described)}")
    tasks[0].try_out()
    return tasks[0], sources


#: Experiments, all of them with the report, and the report.
NAMES = (
    *("success", "transfer", "behaviour", "sample-efficiency", "sensitivity", "cost"),
    *("all", "report"),
)


@click.command()
@click.argument("name", type=click.Choice(NAMES))
@click.argument("task")
@click.option(
    "--size",
    "size_name",
    type=click.Choice(["smoke", "local", "paper"]),
    default="local",
    show_default=True,
    help="Numbers of NES runs and agents: smoke, local, or paper.",
)
@click.option("--ses", type=click.IntRange(1, 1000), help="SEs per condition.")
@click.option("--agents", "per_se", type=POSITIVE, help="Agents of each kind on each SE.")
@click.option("--real-agents", type=POSITIVE, help="Agents of each kind on the real task.")
@workers_option
@common_options
def experiment(
    name: str,
    task: str,
    size_name: str,
    ses: int | None,
    per_se: int | None,
    real_agents: int | None,
    workers: int | None,
    **options: Any,
) -> None:
    """Run the paper's experiment NAME on TASK, or write a report of all finished experiments.

    NAME is success, transfer, behaviour, sample-efficiency, sensitivity, cost, all or report. NES
    runs in the same home learn the SEs, and all experiments of a task share them. The same command
    resumes, and a larger size extends earlier results (docs/experiments.md).
    """
    from cluster.experiments.sizes import SIZES

    size = SIZES[size_name].changed(ses, per_se, real_agents)
    common = RunOptions(task=task, **options)
    the_task, agents = common.the_task(), common.the_agents()
    if the_task.continuous:
        raise InvalidInput(f"experiments need discrete actions; {task} has continuous ones")
    context = the_context(**options)

    from cluster.experiments.command import ExperimentCommand, run_experiments
    from cluster.experiments.figures import EXPERIMENTS
    from cluster.experiments.report import write_report

    experiments = [found for found in EXPERIMENTS.values() if name in (found.name, "all")]
    command = ExperimentCommand(the_task, size, common.seed, context, agents, workers)
    if experiments:
        run_experiments(command, experiments)
    if name in ("all", "report"):
        write_report(command)
