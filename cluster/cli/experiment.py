"""The command `experiment`."""

from typing import Any

import click

from cluster.cli.decorators import common_options, workers_option
from cluster.cli.options import RunOptions

#: Experiments, all of them with the report, and the report.
NAMES = (
    *("success", "transfer", "behaviour", "sample-efficiency", "sensitivity", "cost"),
    *("all", "report"),
)

_AGENTS = click.IntRange(1, 100_000)


@click.command()
@click.argument("name", type=click.Choice(NAMES))
@click.argument("task")
@click.option(
    "--size",
    "size_name",
    type=click.Choice(["smoke", "local", "paper"]),
    default="local",
    show_default=True,
    help="Numbers of NES runs and agents: smoke (a quick check), local, or paper (the paper's).",
)
@click.option(
    "--ses",
    type=click.IntRange(1, 1000),
    help="SEs per condition, and NES runs per recipe in success (default: the size's).",
)
@click.option(
    "--agents", "per_se", type=_AGENTS, help="Fresh agents of each kind trained on each SE."
)
@click.option("--real-agents", type=_AGENTS, help="Agents of each kind trained on the real task.")
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
    context = common.the_context()

    from cluster.experiments.command import ExperimentCommand, run_experiments
    from cluster.experiments.figures import EXPERIMENTS
    from cluster.experiments.report import write_report

    experiments = [one for one in EXPERIMENTS.values() if name in (one.name, "all")]
    command = ExperimentCommand(the_task, size, common.seed, context, agents, workers)
    if experiments:
        run_experiments(command, experiments)
    if name in ("all", "report"):
        write_report(command)
