"""Options that several commands share, and the objects built from them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bilevel.errors import InvalidInput, one_of
from bilevel.tasks import Task
from cluster.cli.parameters import Setting, WholeNumber
from cluster.cli.places import address_option, home_option, the_context, tracking_option
from cluster.storage.home import Home

if TYPE_CHECKING:
    from bilevel.hyperparameters import Hyperparameters
    from cluster.session.context import RunContext

agent_file_option = click.option(
    "--agent-file",
    "agent_files",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    multiple=True,
    help="Python file that registers an agent (docs/agents.md); may be repeated.",
)

set_option = click.option(
    "--set",
    "settings",
    type=Setting(),
    multiple=True,
    help="Replace a hyperparameter of the recipe, for instance nes.std_dev=0.1 or "
    "ddqn.learning_rate=0.002; may be repeated, for others; in `evaluate` those of agents only.",
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
            "`bohb` draw one of several, `evaluate` and `experiment` train each (default: the "
            "recipe's, ddqn; in `experiment`, the experiment's).",
        ),
        agent_file_option,
        address_option,
        tracking_option,
        home_option,
        click.option(
            "--solved-reward",
            type=float,
            help="Mean return at which the task counts as solved (default: the task's; in "
            "`evaluate` with --real alone).",
        ),
        click.option(
            "--step-limit",
            type=WholeNumber(min=1),
            help="Maximum number of steps per episode of the real task (default: the task's; in "
            "`evaluate` with --real alone).",
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
            "for the profile paper: authors).",
        ),
        set_option,
        vary_option,
        click.option(
            "--population",
            type=WholeNumber(min=1),
            help="NES members per generation, n_p (default: the recipe's).",
        ),
        click.option(
            "--worst-score",
            type=float,
            help="About the lowest mean return of the task: what a diverged agent scores, and from "
            "where a search measures progress (default: the task's).",
        ),
    ]
    function = common_options(function)
    for option in reversed(options):
        function = option(function)
    return click.argument("task")(function)


def once(settings: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Hyperparameters by name. Raises InvalidInput for one that is given twice."""
    values: dict[str, Any] = {}
    for name, value in settings:
        if name in values:
            told = f"{name} is given twice, as {values[name]} and as {value}: give one"
            raise InvalidInput(told)
        values[name] = value
    return values


@dataclass(frozen=True)
class RunOptions:
    """Values of the common options; those with a default do not exist in all commands."""

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
    worst_score: float | None = None

    def the_task(self) -> Task:
        from bilevel.tasks import get_task

        task = get_task(self.task, self.solved_reward, self.step_limit, self.worst_score)
        task.try_out()
        return task

    def the_agents(self) -> tuple[str, ...] | None:
        """Names of the agents, each of them known; None for the recipe's. Raises InvalidInput, and
        without a recipe also for the file of an agent that takes no part."""
        from bilevel.agents import get_agent
        from cluster.ray.agent_files import load_agent_file

        names = () if self.agents is None else tuple(one.strip() for one in self.agents.split(","))
        for file in self.agent_files:
            registered = load_agent_file(file)
            if registered and self.recipe is None and not {*registered} & {*names}:
                raise InvalidInput(
                    f"agent file {str(file)!r} registers {' and '.join(registered)}, which takes "
                    f"no part: give --agent {','.join(registered)}"
                )
        for name in names:
            get_agent(name)
        return names or None

    def the_hyperparameters(
        self,
        task: Task,
        usual_recipe: str = "default",
        sized: Callable[["Hyperparameters"], "Hyperparameters"] = lambda hp: hp,
        **nes: Any,
    ) -> "Hyperparameters":
        """The recipe's hyperparameters, as `sized` changes them, with the options' replacements;
        `nes` has those of the command's own options, None where one is not given. Raises
        InvalidInput, also for a hyperparameter that is given twice."""
        from bilevel.hyperparameters import load_recipe
        from search_spaces.translation import to_hyperparameters

        name, file = self._recipe(task, usual_recipe)
        hp = sized(replace(load_recipe(file, task.id, self.the_agents()), recipe=name))
        vary: Any = self.vary or hp.vary_agent  # checked where it is set
        hp = replace(hp, vary_agent=vary)
        own = [(f"nes.{field}", value) for field, value in nes.items() if value is not None]
        return to_hyperparameters(hp, once([*own, *self.replaced]))

    @property
    def replaced(self) -> list[tuple[str, Any]]:
        """The hyperparameters that the options replace, with their values."""
        own = [] if self.population is None else [("nes.population_size", self.population)]
        return [*own, *self.settings]

    def _recipe(self, task: Task, usual: str) -> tuple[str, str]:
        """Name of the recipe, and the same or its file: for a study on the task, the incumbent's.
        Raises InvalidInput for any other name, and for a run that has found none."""
        from bilevel.hyperparameters import RECIPES

        given = self.recipe or usual
        if given in RECIPES or given.endswith(".toml"):
            return Path(given).stem, given

        from cluster.bohb.study.definition import RECIPE_FILE

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
