"""Options that several commands share, and their types."""

import json
import re
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Any

import click

from cluster.storage.home import DEFAULT_HOME

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

#: A number of at least 1.
POSITIVE = click.IntRange(min=1)

#: A file that a command writes, or reads itself.
FILE = click.Path(path_type=Path, dir_okay=False)

_SECONDS = {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}


def seconds(text: str) -> float:
    """Parse `90s`, `45m`, `2h` or plain seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)", text)
    if match is None or float(match[1]) == 0:
        raise click.BadParameter(f"{text!r} is not a duration such as 90s, 45m or 2h")
    return float(match[1]) * _SECONDS[match[2]]


def setting(text: str) -> tuple[str, Any]:
    """Parse `section.field=value` into the name and a number, bool or string."""
    name, _, value = text.partition("=")
    if not (name and value):
        raise click.BadParameter(f"{text!r} is not a setting such as nes.std_dev=0.03")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def env_kwarg(text: str) -> tuple[str, Any]:
    """Parse `key:value` into the key and a Python value or a string."""
    from bilevel.tasks.source import parse_value

    name, _, value = text.partition(":")
    if not (name.isidentifier() and value):
        raise click.BadParameter(f"{text!r} is not a keyword argument such as is_slippery:False")
    return name, parse_value(value)


def combined(*decorators: Decorator) -> Decorator:
    """Return a decorator that adds several options; help lists them in this order."""
    return lambda command: reduce(lambda f, decorator: decorator(f), decorators[::-1], command)


home_option = click.option(
    "--home",
    type=click.Path(file_okay=False, path_type=Path),
    default=DEFAULT_HOME,
    show_default=True,
    help="Folder of checkpoints, journals and MLflow's database.",
)
tracking_option = click.option(
    "--tracking-uri",
    envvar="MLFLOW_TRACKING_URI",
    help="MLflow server or database (default: $MLFLOW_TRACKING_URI, else SQLite in --home).",
)
address_option = click.option(
    "--address",
    envvar="RAY_ADDRESS",
    help="Ray cluster with a node on this machine: host:port, auto, or local for a new one "
    "(default: $RAY_ADDRESS, else local).",
)
agent_file_option = click.option(
    "--agent-file",
    "agent_files",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    multiple=True,
    help="Python file that registers an agent for --agent (docs/agents.md); may be repeated.",
)
#: Options that change hyperparameters.
hp_options = combined(
    click.option(
        "--set",
        "settings",
        type=setting,
        multiple=True,
        metavar="SECTION.FIELD=VALUE",
        help="Replace a hyperparameter of the recipe, as in nes.std_dev=0.1; may be repeated.",
    ),
    click.option(
        "--vary-hp",
        "vary",
        type=click.Choice(["no", "small", "narrowed", "all"]),
        help="Draw the agents' learning rate, batch size and network from the paper's ranges: all "
        "of them, small and cheap ones, or narrowed, with narrow networks instead of large ones.",
    ),
)
workers_option = click.option(
    "--workers", type=POSITIVE, help="Actors (default: one per core of the cluster)."
)
task_option = click.option(
    "--task",
    "se_task",
    metavar="MODULE:ID",
    help="Task of the SE, as given to `nes`, if a custom module registers it.",
)

#: Options of all commands that train agents.
common_options = combined(
    click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed."),
    click.option(
        "--agent",
        "agents",
        help="Agents, comma-separated: ddqn, dueling-ddqn, td3, ppo or custom ones. `nes` and "
        "`bohb` draw one of them per agent, other commands train each (default: the recipe's; "
        "`evaluate`: those of the recipe default; `experiment`: its own).",
    ),
    agent_file_option,
    address_option,
    tracking_option,
    home_option,
    click.option("--solved-reward", type=float, help="Mean return that solves the task."),
    click.option("--step-limit", type=POSITIVE, help="Maximum steps per episode of the real task."),
)

#: Options of the commands that learn SEs.
run_options = combined(
    click.argument("task"),
    click.option(
        "--recipe",
        help="Hyperparameters: default, paper, authors, a recipe file (*.toml), or a study, for "
        "its incumbent's (default: default; for the profile paper: authors).",
    ),
    click.option(
        "--env-kwargs",
        type=env_kwarg,
        multiple=True,
        metavar="KEY:VALUE",
        help="Keyword argument of the environment, as in is_slippery:False; may be repeated.",
    ),
    click.option(
        "--wrapper",
        "wrappers",
        multiple=True,
        metavar="MODULE:CLASS",
        help="Wrapper of the environment; may be repeated, the innermost first.",
    ),
    hp_options,
    click.option("--population", type=POSITIVE, help="NES members per generation, n_p."),
    click.option(
        "--worst-score",
        type=float,
        help="Approximate lower bound of the mean return, which a diverged agent scores.",
    ),
    common_options,
)
