"""Options that several commands share, and the objects built from them."""

import functools
import json
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bilevel.errors import InvalidInput
from bilevel.tasks import Task
from cluster.storage.home import DEFAULT_HOME, Home

if TYPE_CHECKING:
    from bilevel.hyperparameters import Hyperparameters
    from bilevel.synthetic_env import StoredSE
    from cluster.session.context import RunContext

_SECONDS = {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}


class Duration(click.ParamType[float]):
    """Parses `90s`, `45m`, `2h` or plain seconds into a float of seconds."""

    name = "duration"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)", str(value))
        if match is None or float(match[1]) == 0:
            self.fail(
                f"{value!r} is not a duration: allowed are 90s, 45m, 2h, or a number of seconds"
            )
        return float(match[1]) * _SECONDS[match[2]]


class WholeNumber(click.IntRange):
    """An IntRange that also names the allowed range if the value is not an integer."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        if not re.fullmatch(r"[+-]?\d+", str(value)):
            allowed = f"{self.min} or more" if self.max is None else f"{self.min} to {self.max}"
            self.fail(f"{value!r} is not a whole number: allowed are {allowed}")
        number: int = super().convert(value, param, ctx)
        return number


class Setting(click.ParamType[tuple[str, Any]]):
    """Parses `section.field=value` into the name and a number, bool or string."""

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


@dataclass(frozen=True)
class GivenSE:
    """The file of an SE that the command line names."""

    path: Path
    label: str  # what it is called in tables, names and pictures

    @classmethod
    def of(cls, path: Path) -> "GivenSE":
        """That of a path."""
        return cls(path, label_of(path))


class SEAddress(click.ParamType[GivenSE]):
    """A file of an SE, given as its path, as a name of the zoo, or as MLflow's address."""

    name = "SE"

    def convert(
        self, value: Any, param: click.Parameter | None, context: click.Context | None
    ) -> GivenSE:
        """The file. Raises InvalidInput if MLflow, which `--home` and `--tracking-uri` of the same
        command tell, cannot be reached or has none at an address."""
        from bilevel.gym.source import is_of_mlflow, pinned, se_file
        from bilevel.zoo import ENTRIES, zoo_file

        if value in ENTRIES:
            return GivenSE.of(zoo_file(value))
        if not is_of_mlflow(value):
            return GivenSE.of(Path(value))
        from cluster.tracking.tracker import check_tracking_uri

        given = {} if context is None else context.params
        home = Home(given.get("home") or DEFAULT_HOME)
        uri = the_tracking_uri(given.get("tracking_uri"), home)
        if uri == home.database_uri and not (home.folder / "mlflow.db").exists():
            raise InvalidInput(f"MLflow has no SE at {value!r}: no runs in {str(home.folder)!r}")
        check_tracking_uri(uri)
        address = pinned(value, uri)
        return GivenSE(se_file(address, uri), _label_at(address))


#: Files that every run, study or model has.
_USUAL = {"best_se", "last_se", "incumbent_se"}


def label_of(path: Path) -> str:
    """What an SE is called by its file: the name of the file or, if every run has one of that name,
    of the run's folder."""
    folder = path.resolve().parent
    usual = path.stem in _USUAL and (folder / "settings.json").exists()
    return folder.name if usual else path.stem


def _label_at(address: str) -> str:
    """What an SE is called by MLflow's address: `NAME-VERSION` for models:/NAME/VERSION, and else
    the file's name or, if every run has one of that name, the run's ID."""
    kind, _, place = address.partition(":/")
    if kind == "models":
        return place.replace("/", "-")
    *folders, file = (part for part in Path(place).parts if part != "artifacts")
    return folders[-1] if folders and Path(file).stem in _USUAL else Path(file).stem


def load_se_of(path: Path, task: str | None) -> "StoredSE":
    """The SE in a file; `task`, if given, is the id of its task, whose module is imported. Raises
    InvalidInput for another task."""
    from bilevel.synthetic_env import load_se
    from bilevel.tasks import get_task

    stored = load_se(path)
    if task is not None:
        if task != stored.task_id:
            raise InvalidInput(f"--task {task}: {str(path)!r} is an SE for {stored.task_id}")
        get_task(task, stored.solved_reward, stored.step_limit)
    return stored


class Folder(click.ParamType[Path]):
    """Parses the path of a folder, which need not exist."""

    name = "folder"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        if not str(value):
            self.fail("'' is not a folder: give its path")
        return Path(value)


home_option = click.option(
    "--home",
    type=Folder(),
    default=DEFAULT_HOME,
    show_default=True,
    is_eager=True,  # as --tracking-uri: the address of an SE is read by them
    help="Folder of checkpoints, journals and MLflow's database.",
)

agent_file_option = click.option(
    "--agent-file",
    "agent_files",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    multiple=True,
    help="Python file that registers an agent (docs/agents.md); may be repeated.",
)

task_option = click.option(
    "--task",
    "se_task",
    metavar="MODULE:ID",
    help="The SE's task, as it was learned for, if a module of yours registers it: the module is "
    "imported.",
)

vary_option = click.option(
    "--vary-hp",
    "vary",
    metavar="no|small|narrowed|all",
    help="Draw the agents' learning rate, batch size and network from the paper's ranges: no, "
    "small (cheap networks and batches only), all, or narrowed (all, but narrow networks learning "
    "at the same pace replace the large ones) (default: the recipe's; in evaluate: no).",
)

workers_option = click.option(
    "--workers", type=WholeNumber(min=1), help="Actors (default: one per core of the run's share)."
)

tracking_option = click.option(
    "--tracking-uri",
    is_eager=True,
    help="URI of an MLflow server or database (default: $MLFLOW_TRACKING_URI, else the server of "
    "`up`, else a SQLite database in --home).",
)


address_option = click.option(
    "--address",
    help="Ray cluster to join: host:port, ray://host:port, auto, or local for a new one "
    "(default: $RAY_ADDRESS, else the head of `up`, else local).",
)


def mlflow_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--home` and `--tracking-uri` of a command that uses them for the address of an SE alone."""

    @functools.wraps(function)
    def without_them(*, home: Path, tracking_uri: str | None, **values: Any) -> Any:
        return function(**values)

    return home_option(tracking_option(without_them))


def the_tracking_uri(given: str | None, home: Home) -> str:
    """The tracking URI: the option, MLFLOW_TRACKING_URI, the home's server, or its database."""
    from cluster.services.background import join

    named = given or os.environ.get("MLFLOW_TRACKING_URI")
    return named or join("mlflow", home) or home.database_uri


def the_address(given: str | None, home: Home) -> str | None:
    """Address of the Ray cluster to join: the option, RAY_ADDRESS, or the home's head.

    None starts a local cluster.
    """
    from cluster.services.background import join

    named = given or os.environ.get("RAY_ADDRESS") or join("ray", home)
    return None if named == "local" else named


def the_context(home: Path, tracking_uri: str | None, address: str | None) -> "RunContext":
    """Home, MLflow and Ray cluster: those of the options, or the services of `up`.

    Must be called before any import of Ray, which reads the environment set here.
    """
    in_home = Home(home)
    uri, cluster = the_tracking_uri(tracking_uri, in_home), the_address(address, in_home)

    from cluster.session.context import RunContext

    return RunContext(in_home, uri, cluster)


def common_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options of all commands that train agents."""
    options = [
        click.option(
            "--seed",
            type=WholeNumber(min=0),
            default=0,
            show_default=True,
            help="Seed of all random numbers.",
        ),
        click.option(
            "--agent",
            "agents",
            help="Agents, comma-separated: ddqn, dueling-ddqn, td3 or registered ones. `nes` and "
            "`bohb` draw one of several, `evaluate` trains each (default: the recipe's, ddqn).",
        ),
        agent_file_option,
        address_option,
        tracking_option,
        home_option,
        click.option(
            "--solved-reward",
            type=float,
            help="Mean return at which the task counts as solved (default: the task's).",
        ),
        click.option(
            "--step-limit",
            type=WholeNumber(min=1),
            help="Maximum number of steps per episode of the real task (default: the task's).",
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def run_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options of the commands that learn SEs."""
    options = [
        click.option(
            "--recipe",
            help="All hyperparameters of a run: default, paper, authors, distilled, the path of a "
            "recipe file, *.toml, or the name of a study, for its incumbent's (default: default; "
            "for the profile paper: paper).",
        ),
        click.option(
            "--set",
            "settings",
            type=Setting(),
            multiple=True,
            help="Replace a hyperparameter of the recipe, for instance nes.std_dev=0.1 or "
            "ddqn.learning_rate=0.002; may be repeated.",
        ),
        vary_option,
        click.option(
            "--population",
            type=WholeNumber(min=1),
            help="NES members per generation, n_p (default: the recipe's).",
        ),
    ]
    function = common_options(function)
    for option in reversed(options):
        function = option(function)
    return click.argument("task")(function)


@dataclass(frozen=True)
class RunOptions:
    """Values of the common options; `population` and below only exist for `nes` and `bohb`."""

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

    def the_hyperparameters(
        self,
        task: Task,
        usual_recipe: str = "default",
        sized: Callable[["Hyperparameters"], "Hyperparameters"] = lambda hp: hp,
    ) -> "Hyperparameters":
        """The recipe's hyperparameters, as `sized` changes them, with the options' replacements.
        Raises InvalidInput."""
        from bilevel.hyperparameters import load_recipe
        from search_spaces import to_hyperparameters

        name, file = self._recipe(task, usual_recipe)
        hp = sized(replace(load_recipe(file, task.id, self.the_agents()), recipe=name))
        vary: Any = self.vary or hp.vary_agent  # checked where it is set
        hp = replace(hp, vary_agent=vary)
        if self.population is not None:
            hp = replace(hp, nes=replace(hp.nes, population_size=self.population))
        return to_hyperparameters(hp, dict(self.settings))

    def _recipe(self, task: Task, usual: str) -> tuple[str, str]:
        """Name of the recipe, and the same or its file: for a study on the task, the incumbent's.
        Raises InvalidInput for any other name, and for a run that has found none."""
        from bilevel.errors import InvalidInput, one_of
        from bilevel.hyperparameters import RECIPES

        given = self.recipe or usual
        if given in RECIPES or given.endswith(".toml"):
            return Path(given).stem, given

        from cluster.bohb.study import RECIPE_FILE

        runs = {folder.name: folder for folder in Home(self.home).runs(task.id)}
        found = [name for name, folder in runs.items() if (folder / RECIPE_FILE).exists()]
        if given in found:
            return given, str(runs[given] / RECIPE_FILE)
        if given in runs:
            raise InvalidInput(
                f"{given!r} on {task.id} has found no recipe: give a study that has run to its end"
            )
        studies = f"studies on {task.id} that have found one ({', '.join(found) or 'none yet'})"
        raise one_of("recipe", given, (*RECIPES, "recipe files (*.toml)", studies))

    def suffix(self, recipe: str) -> str:
        """Part of a default name that states recipe, agents and variation."""
        agents = "" if self.agents is None else "-" + self.agents.replace(",", "-").replace(" ", "")
        return f"-{recipe}{agents}" + (f"-{self.vary}" if self.vary else "")

    def the_context(self) -> "RunContext":
        """See `the_context`."""
        return the_context(self.home, self.tracking_uri, self.address)
