"""The definition of a study: everything that stays the same when it is resumed."""

import json
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from bilevel.durable import write_aside
from bilevel.hyperparameters import Hyperparameters, StoredHyperparameters
from bilevel.recipes import recipe_text
from bilevel.tasks import Task
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import ConfigId, Configuration
from cluster.bohb.study.profiles import METHODS
from cluster.storage.run_folder import Settings, settings_of
from search_spaces.space import Space
from search_spaces.translation import of_hyperparameters, to_hyperparameters

#: Kind of run in `settings.json`.
KIND = "study"

#: Recipe of the incumbent.
RECIPE_FILE = "recipe.toml"

#: The space as ConfigSpace writes it; other tools read a study from it and the journal.
SPACE_FILE = "configspace.json"


def configuration_name(config_id: ConfigId) -> str:
    """Return `bracket-rung-number`, zero-padded so that names sort."""
    bracket, rung, number = config_id
    return f"{bracket:03d}-{rung}-{number:03d}"


@dataclass(frozen=True, kw_only=True)
class StudySettings(Settings):
    """Settings of a study."""

    space: str | Space
    method: str
    prior: str
    budgets: tuple[int, ...]
    cycle: int
    base: StoredHyperparameters

    noun = "study"

    @property
    def schedule(self) -> Schedule:
        """The budgets of the study and the order of its brackets."""
        return Schedule(self.budgets, self.cycle)


@dataclass(frozen=True)
class Study:
    """A search over NES runs on a task."""

    folder: Path
    task: Task
    seed: int
    space: Space
    schedule: Schedule
    base: Hyperparameters  # hyperparameters that a configuration does not set
    method: str = "bohb"  # of METHODS
    prior: str = "none"  # or recipe, see `ConfigGenerator`

    @property
    def name(self) -> str:
        """The study's name."""
        return self.folder.name

    @property
    def title(self) -> str:
        """Method, task and name of the study."""
        return f"{METHODS[self.method]} on {self.task.id}: study {self.name!r}"

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents that evaluations train."""
        return tuple(hp.agent for hp in self.base.agents)

    @cached_property
    def recipe_values(self) -> Configuration:
        """The recipe's values in the dimensions of the space, which may lie outside their range."""
        values = of_hyperparameters(self.base, self.space.build(self.agents))
        if values.get("se.step_limit") == 0:  # the task's
            values["se.step_limit"] = self.task.step_limit
        return values

    def prior_configuration(self) -> Configuration | None:
        """Return the configuration nearest to the recipe, if the recipe is the prior. Raises
        InvalidInput if the space forbids it."""
        if self.prior != "recipe":
            return None
        from search_spaces.prior import nearest  # imports ConfigSpace, which trials do not need

        return nearest(self.space.build(self.agents), self.recipe_values)

    def recipe_text(self, config_id: ConfigId, configuration: Configuration) -> str:
        """Return the recipe file of a configuration."""
        heading = f"Found by the study {self.name!r}: configuration {configuration_name(config_id)}"
        return recipe_text(to_hyperparameters(self.base, configuration), heading)

    def write_space(self) -> None:
        """Write SPACE_FILE. Raises StorageFailure."""
        content = self.space.build(self.agents).to_serialized_dict()
        write_aside(self.folder / SPACE_FILE, json.dumps(content, indent=2).encode())

    def settings(self) -> dict[str, Any]:
        """Return the settings to store."""
        return {
            **settings_of(KIND, self.task, self.seed),
            "space": self.space.name if self.space.content is None else asdict(self.space),
            "method": self.method,
            "prior": self.prior,
            "budgets": list(self.schedule.budgets),
            "cycle": self.schedule.cycle,
            "base": self.base.to_dict(),
        }

    @classmethod
    def read(cls, folder: Path) -> "Study":
        """Read the study in a folder. Raises InvalidInput."""
        settings = StudySettings.read(folder)
        return cls(
            folder,
            settings.task,
            settings.seed,
            settings.space if isinstance(settings.space, Space) else Space(settings.space),
            settings.schedule,
            settings.base.checked(),
            settings.method,
            settings.prior,
        )
