"""The command `evaluate`."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from cluster.cli.options import RunOptions, common_options


@click.command()
@click.argument(
    "files", metavar="[SE]...", nargs=-1, type=click.Path(path_type=Path, dir_okay=False)
)
@click.option("--real", metavar="TASK", help="Train on the real task, too: the baseline.")
@click.option(
    "--agents",
    "count",
    type=click.IntRange(min=1),
    default=10,
    show_default=True,
    help="Fresh agents of each kind on each source.",
)
@click.option(
    "--vary-hp/--no-vary-hp",
    default=False,
    help="Draw each agent's learning rate, batch size and network anew.",
)
@click.option("--preset", default="default", show_default=True, help="tuned or default.")
@click.option("--max-episodes", type=click.IntRange(min=1), help="Training episodes at most.")
@click.option("--workers", type=click.IntRange(min=1), help="Actors; default all cores.")
@click.option("--name", help="Of the evaluation; the same name goes on where it was.")
@common_options
def evaluate(
    files: tuple[Path, ...],
    real: str | None,
    count: int,
    vary_hp: bool,
    preset: str,
    max_episodes: int | None,
    workers: int | None,
    name: str | None,
    **options: Any,
) -> None:
    """Train fresh agents on SE files (or on the real task) and test them on the real task.

    Several kinds, --agent ddqn,td3, are each trained --agents times.
    """
    from bilevel.errors import InvalidInput
    from bilevel.hyperparameters import load_preset
    from bilevel.synthetic_env import StoredSE, load_se
    from bilevel.tasks import get_task
    from cluster.evaluate_command import EvaluateCommand, run_evaluate

    if not files and real is None:
        raise InvalidInput("nothing to train on: give SE files, or --real TASK")
    sources: dict[str, StoredSE | None] = {}
    tasks = [] if real is None else [RunOptions(task=real, **options).the_task()]
    for file in files:
        se = load_se(file)
        label = file.stem if file.stem not in sources else f"{file.parent.name}-{file.stem}"
        if label in sources or label == "real":
            raise InvalidInput(f"two sources are called {label!r}: rename {str(file)!r}")
        sources[label] = se
        tasks.append(get_task(se.task_id, se.solved_reward, se.step_limit))
    if real is not None:
        sources["real"] = None
    task = tasks[0]
    if any((t.id, t.state_size) != (task.id, task.state_size) for t in tasks):
        raise InvalidInput(f"sources of several tasks: {', '.join(sorted({t.id for t in tasks}))}")
    common = RunOptions(task=task.id, **options)
    kinds = load_preset(preset, task.id, agents=common.the_agents()).agents
    if max_episodes is not None:
        kinds = tuple(replace(hp, max_episodes=max_episodes) for hp in kinds)
    varied = "-vary-hp" if vary_hp else ""
    among = "-".join(hp.agent for hp in kinds)
    run_evaluate(
        EvaluateCommand(
            task,
            sources,
            kinds,
            count,
            vary_hp,
            common.seed,
            name or f"evaluate-{'-'.join(sources)}-{among}{varied}-seed{common.seed}"[:80],
            common.the_place(),
            workers,
        )
    )
