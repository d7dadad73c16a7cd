"""Objects that commands build from their shared options."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bilevel.errors import InvalidInput, unknown_value
from bilevel.tasks import Task
from cluster.storage.home import Home

if TYPE_CHECKING:
    from bilevel.hyperparameters import Hyperparameters
    from cluster.session.context import RunContext


def once(settings: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Return hyperparameters by name. Raises InvalidInput for a name that is given twice."""
    values: dict[str, Any] = {}
    for name, value in settings:
        if name in values:
            raise InvalidInput(
                f"{name} is given twice, as {values[name]} and as {value}: give one value"
            )
        values[name] = value
    return values


@dataclass(frozen=True)
class RunOptions:
    """Values of the shared options. Not all commands have the options with a default."""

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
        """Load the agent files and return the names of the agents, or None for the recipe's.

        Raises InvalidInput for an unknown agent, and for a file whose agents are not used.
        """
        from bilevel.agents import get_agent
        from cluster.ray.agent_files import load_agent_file

        names = () if self.agents is None else tuple(map(str.strip, self.agents.split(",")))
        for file in self.agent_files:
            registered = load_agent_file(file)
            if registered and self.recipe is None and not {*registered} & {*names}:
                raise InvalidInput(
                    f"agent file {str(file)!r} registers {' and '.join(registered)}, which this "
                    f"command does not use: give --agent {','.join(registered)}"
                )
        for name in names:
            get_agent(name)
        return names or None

    def the_hyperparameters(
        self,
        task: Task,
        default_recipe: str = "default",
        sized: Callable[["Hyperparameters"], "Hyperparameters"] = lambda hp: hp,
        **nes: Any,
    ) -> "Hyperparameters":
        """Return the recipe's hyperparameters, changed by `sized` and then by the options.

        `nes` contains fields of NES from options of a single command; None keeps a value. Raises
        InvalidInput, also for a hyperparameter that is given twice.
        """
        from bilevel.recipes import load_recipe
        from search_spaces.translation import to_hyperparameters

        name, file = self._recipe(task, default_recipe)
        hp = sized(replace(load_recipe(file, task.id, self.the_agents()), recipe=name))
        vary: Any = self.vary or hp.vary_agent  # checked by Hyperparameters
        own = [(f"nes.{field}", value) for field, value in nes.items() if value is not None]
        return to_hyperparameters(replace(hp, vary_agent=vary), once([*own, *self.replaced]))

    @property
    def replaced(self) -> list[tuple[str, Any]]:
        """Hyperparameters that the options replace, with their values."""
        own = [] if self.population is None else [("nes.population_size", self.population)]
        return [*own, *self.settings]

    def _recipe(self, task: Task, default: str) -> tuple[str, str]:
        """Return the recipe's name, and the name or file for `load_recipe`: the incumbent's file if
        the recipe is a study on the task. Raises InvalidInput."""
        from bilevel.recipes import RECIPES

        given = self.recipe or default
        if given in RECIPES or given.endswith(".toml"):
            return Path(given).stem, given

        from cluster.bohb.study.definition import RECIPE_FILE

        runs = {folder.name: folder for folder in Home(self.home).runs(task.id)}
        studies = [name for name, folder in runs.items() if (folder / RECIPE_FILE).exists()]
        if given in studies:
            return given, str(runs[given] / RECIPE_FILE)
        if given in runs:
            raise InvalidInput(f"{given!r} on {task.id} has no recipe: give a finished study")
        finished = f"finished studies on {task.id} ({', '.join(studies) or 'none yet'})"
        raise unknown_value("recipe", given, (*RECIPES, "recipe files (*.toml)", finished))

    def suffix(self, recipe: str) -> str:
        """Return the part of a default name that states recipe, agents and variation."""
        agents = "" if self.agents is None else "-" + self.agents.replace(",", "-").replace(" ", "")
        return f"-{recipe}{agents}" + (f"-{self.vary}" if self.vary else "")

    def the_context(self) -> "RunContext":
        return the_context(self.home, self.tracking_uri, self.address)


def the_context(home: Path, tracking_uri: str | None, address: str | None) -> "RunContext":
    """Return home, MLflow and Ray cluster of a command."""
    from cluster.session.context import RunContext

    place = Home(home)
    uri = tracking_uri or place.database_uri
    return RunContext(place, uri, None if address == "local" else address, tracking_uri is not None)
