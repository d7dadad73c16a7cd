"""Options that several commands share, and what becomes of them."""

import json
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bilevel.tasks import Task
from cluster.storage.home import Home

if TYPE_CHECKING:
    from bilevel.hyperparameters import Hyperparameters
    from cluster.session.place import Place

_SECONDS = {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}


class Duration(click.ParamType[float]):
    """`90s`, `45m`, `2h`, or plain seconds; a float of seconds."""

    name = "duration"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)", str(value))
        if match is None or float(match[1]) == 0:
            self.fail(f"{value!r} is not a duration: allowed are 90s, 45m, 2h")
        return float(match[1]) * _SECONDS[match[2]]


class WholeNumber(click.IntRange):
    """An IntRange that says what is allowed of anything else than a number, too."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        if not re.fullmatch(r"[+-]?\d+", str(value)):
            allowed = f"{self.min} or more" if self.max is None else f"{self.min} to {self.max}"
            self.fail(f"{value!r} is not a whole number: allowed are {allowed}")
        number: int = super().convert(value, param, ctx)
        return number


class Setting(click.ParamType[tuple[str, Any]]):
    """`section.field=value`; a pair of the name and the value as number, truth or text."""

    name = "section.field=value"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, Any]:
        name, equals, text = str(value).partition("=")
        if not (name and equals and text):
            self.fail(f"{value!r} is not a setting: it has the form nes.std_dev=0.03")
        try:
            return name, json.loads(text)
        except ValueError:
            return name, text


#: Where everything lies.
home_option = click.option(
    "--home",
    type=click.Path(path_type=Path),
    default="runs",
    show_default=True,
    help="Folder for checkpoints, journals, and MLflow's database.",
)

#: Agents of the user's own.
agent_file_option = click.option(
    "--agent-file",
    "agent_files",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    multiple=True,
    help="Python file that registers an agent (docs/agents.md).",
)

#: Agents that differ.
vary_option = click.option(
    "--vary-hp",
    "vary",
    metavar="no|small|all",
    help="Draw each agent's learning rate, batch size and network anew from the paper's "
    "ranges: all of them, or small networks and batches.",
)

#: Where runs are tracked.
tracking_option = click.option(
    "--tracking-uri",
    help="MLflow server or database; else the server of `up`, or a database in the home.",
)


def the_tracking_uri(given: str | None, home: Home) -> str:
    """The tracking URI: given, of the environment, of the home's server, or its database."""
    from cluster.services.background import join

    named = given or os.environ.get("MLFLOW_TRACKING_URI")
    return named or join("mlflow", home) or home.database_uri


def the_address(given: str | None, home: Home) -> str | None:
    """Address of the Ray cluster to join: given, of the environment, or of the home's
    head; None for a cluster of the process's own."""
    from cluster.services.background import join

    named = given or os.environ.get("RAY_ADDRESS") or join("ray", home)
    return None if named == "local" else named


def common_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options that all commands which train agents have in common."""
    options = [
        click.option("--seed", type=WholeNumber(min=0), default=0, show_default=True),
        click.option(
            "--agent",
            "agents",
            help="Agent to train: ddqn, dueling-ddqn, td3 or one of your own; several, "
            "comma-separated: each evaluation draws one (default: the recipe's, ddqn).",
        ),
        agent_file_option,
        click.option(
            "--address",
            help="Ray cluster to join (host:port, auto); else that of `up`, or a local one.",
        ),
        tracking_option,
        home_option,
        click.option("--solved-reward", type=float, help="For tasks whose spec has none."),
        click.option(
            "--step-limit", type=WholeNumber(min=1), help="For tasks whose spec has none."
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def run_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options that the commands which learn SEs have in common."""
    options = [
        click.option(
            "--recipe",
            help="All hyperparameters of a run: default, paper, authors, distilled, or the path "
            "of a recipe file (*.toml); default: default, in the profile paper: paper.",
        ),
        click.option(
            "--set",
            "settings",
            type=Setting(),
            multiple=True,
            help="Replace a hyperparameter of the recipe, as nes.std_dev=0.1 or "
            "ddqn.learning_rate=0.002; may be repeated.",
        ),
        vary_option,
        click.option("--population", type=WholeNumber(min=1), help="NES members a generation."),
    ]
    function = common_options(function)
    for option in reversed(options):
        function = option(function)
    return click.argument("task")(function)


@dataclass(frozen=True)
class RunOptions:
    """The values of these options."""

    task: str
    seed: int
    agents: str | None
    agent_files: tuple[Path, ...]
    address: str | None
    tracking_uri: str | None
    home: Path
    solved_reward: float | None
    step_limit: int | None
    population: int | None = None
    recipe: str | None = None
    settings: tuple[tuple[str, Any], ...] = ()
    vary: str | None = None

    def the_task(self) -> Task:
        from bilevel.tasks import get_task

        return get_task(self.task, self.solved_reward, self.step_limit)

    def the_agents(self) -> tuple[str, ...] | None:
        """Names of the agents, each of them known; None for the recipe's. Raises InvalidInput."""
        from bilevel.agents import get_agent
        from cluster.ray.agent_files import load_agent_file

        for file in self.agent_files:
            load_agent_file(file)
        if self.agents is None:
            return None
        names = tuple(name.strip() for name in self.agents.split(","))
        for name in names:
            get_agent(name)
        return names

    def the_hyperparameters(self, task: Task, usual_recipe: str = "default") -> "Hyperparameters":
        """Those of the recipe, with what the options replace. Raises InvalidInput."""
        from bilevel.hyperparameters import load_recipe
        from search_spaces import to_hyperparameters

        hp = load_recipe(self.recipe or usual_recipe, task.id, self.the_agents())
        vary: Any = self.vary or hp.vary_agent  # checked where it is set
        hp = replace(hp, vary_agent=vary)
        if self.population is not None:
            hp = replace(hp, nes=replace(hp.nes, population_size=self.population))
        return to_hyperparameters(hp, dict(self.settings))

    def suffix(self, recipe: str) -> str:
        """What recipe, agents and variation add to a default name."""
        agents = "" if self.agents is None else "-" + self.agents.replace(",", "-").replace(" ", "")
        return f"-{recipe}{agents}" + (f"-{self.vary}" if self.vary else "")

    def the_place(self) -> "Place":
        """Home, MLflow and Ray cluster: given, or those that `up` has started. To be called
        before anything is imported that imports Ray."""
        home = Home(self.home)
        tracking_uri = the_tracking_uri(self.tracking_uri, home)
        address = the_address(self.address, home)

        from cluster.session.place import Place  # imports Ray, which reads what joining has set

        return Place(home, tracking_uri, address)
