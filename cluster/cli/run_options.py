"""Objects that commands build from their shared options."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bilevel.errors import InvalidInput
from bilevel.tasks import Task
from cluster.storage.home import Home
from cluster.storage.run_folder import SETTINGS_FILE, read_settings, stored_task

if TYPE_CHECKING:
    from bilevel.hyperparameters import Hyperparameters
    from cluster.session.context import RunContext


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
    env_kwargs: tuple[tuple[str, Any], ...] = ()
    wrappers: tuple[str, ...] = ()

    def the_task(self, timed: bool = False) -> Task:
        """Return the task after some random steps, which may measure the time of a real step."""
        from bilevel.tasks import get_task

        values = self.solved_reward, self.step_limit, self.worst_score
        wrappers = self.wrappers
        task = get_task(self.task, *values, env_kwargs=dict(self.env_kwargs), wrappers=wrappers)
        seconds = float(f"{task.try_out():.2g}")
        return replace(task, measured_step_seconds=seconds) if timed and not task.compiled else task

    @staticmethod
    def resumed(task: Task, folder: Path) -> Task:
        """Return the task with the time of a real step that the run in the folder has measured, if
        there is one: a run keeps its first measurement."""
        if not (folder / SETTINGS_FILE).exists():
            return task
        stored = stored_task(read_settings(folder).get("task"))
        return replace(task, measured_step_seconds=stored.measured_step_seconds)

    def the_agents(self) -> tuple[str, ...] | None:
        """Load the agent files and return the names of the agents, or None for the recipe's."""
        from bilevel.agents import get_agent
        from cluster.ray.agent_files import load_agent_file

        for file in self.agent_files:
            load_agent_file(file)
        names = () if self.agents is None else tuple(map(str.strip, self.agents.split(",")))
        for name in names:
            get_agent(name)  # raises InvalidInput
        if len({*names}) < len(names):
            raise InvalidInput(f"--agent names each agent once; got {self.agents!r}")
        return names or None

    def the_hyperparameters(
        self,
        task: Task,
        default_recipe: str = "default",
        sized: Callable[["Hyperparameters"], "Hyperparameters"] = lambda hp: hp,
        **nes: Any,
    ) -> "Hyperparameters":
        """Return the recipe's hyperparameters, changed by `sized`, by `nes` (fields of NES; None
        keeps a value) and by the options."""
        from bilevel.recipes import RECIPES, load_recipe
        from cluster.bohb.study.definition import RECIPE_FILE
        from search_spaces.translation import to_hyperparameters

        given = source = self.recipe or default_recipe
        if given not in RECIPES and not given.endswith(".toml"):  # a study's incumbent
            file = Home(self.home).run_folder(task.id, given) / RECIPE_FILE
            source = str(file) if file.exists() else given
        loaded = load_recipe(source, task, self.the_agents())
        hp = sized(replace(loaded, recipe=Path(given).name.removesuffix(".toml")))
        vary: Any = self.vary or hp.vary_agent
        own = {f"nes.{field}": value for field, value in nes.items() if value is not None}
        return to_hyperparameters(replace(hp, vary_agent=vary), own | self.replaced)

    @property
    def replaced(self) -> dict[str, Any]:
        """Hyperparameters that the options replace, with their values."""
        own = {} if self.population is None else {"nes.population_size": self.population}
        return own | dict(self.settings)

    def suffix(self, recipe: str) -> str:
        """Return the part of a default name that states recipe, agents and variation."""
        agents = "" if self.agents is None else "-" + self.agents.replace(",", "-").replace(" ", "")
        return f"-{recipe}{agents}" + (f"-{self.vary}" if self.vary else "")


def the_context(
    home: Path, tracking_uri: str | None, address: str | None, **_: Any
) -> "RunContext":
    """Return home, MLflow and Ray cluster of a command."""
    from cluster.session.context import RunContext

    place = Home(home)
    uri = tracking_uri or place.database_uri
    return RunContext(place, uri, None if address == "local" else address)
