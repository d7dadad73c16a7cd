"""The definition of a study, which stays the same wherever and however often it is run."""

import json
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bilevel.decode import decode, differences
from bilevel.durable import checksum, write_aside
from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters import Hyperparameters, StoredHyperparameters, recipe_text
from bilevel.seeds import Purpose, derive
from bilevel.tasks import Task
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import ConfigId, Configuration, Journal
from cluster.bohb.study.profiles import METHODS, get_method
from cluster.nes.run import NESRun, start_of
from cluster.storage.run_folder import SETTINGS_FILE, Settings, read_settings, settings_of
from search_spaces import SPACES
from search_spaces.space import Space
from search_spaces.translation import of_hyperparameters, to_hyperparameters

if TYPE_CHECKING:
    from ConfigSpace import ConfigurationSpace

#: The kind of run that `settings.json` tells.
KIND = "study"

#: File of a study with the recipe of its incumbent.
RECIPE_FILE = "recipe.toml"

#: Where a search may begin besides at another study's results: nowhere, or around its recipe.
PRIORS = ("none", "recipe")

#: Folder of a study with the journal of the study that is its prior.
_EARLIER = "earlier"

#: File of a study with its search space, as ConfigSpace writes it. With it and the journal, which
#: is hpbandster's, other tools open the study's folder as it is.
SPACE_FILE = "configspace.json"


def configuration_name(config_id: ConfigId) -> str:
    """`bracket-rung-number`, zero-padded so that names sort."""
    bracket, rung, number = config_id
    return f"{bracket:03d}-{rung}-{number:03d}"


@dataclass(frozen=True, kw_only=True)
class _Settings(Settings):
    """The settings of a study."""

    space: str | Space
    method: str
    prior: str
    budgets: tuple[int, ...]
    cycle: int
    base: StoredHyperparameters
    search_seed: int | None = None  # if it is not the seed (`Study.search_seed`)


@dataclass(frozen=True)
class Study:
    """A search over NES runs on a task. All of it stays the same when it is continued."""

    folder: Path
    task: Task
    seed: int
    space: Space
    schedule: Schedule
    base: Hyperparameters  # what a configuration leaves unsaid
    method: str = "bohb"  # of METHODS
    prior: str = "none"  # of PRIORS, or the name of a study whose results the model begins with

    @property
    def name(self) -> str:
        """The study's name."""
        return self.folder.name

    @property
    def method_name(self) -> str:
        """Its method, for people."""
        return METHODS[self.method]

    @property
    def start(self) -> str:
        """How its runs start, in words before a comma; nothing where that is searched."""
        searched = self.space.searched(self.agents)
        return "" if "nes.start_candidates" in searched else f"{start_of(self.base.nes)}, "

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents that evaluations draw from."""
        return tuple(hp.agent for hp in self.base.agents)

    @property
    def most_evaluations(self) -> int:
        """Evaluations of a generation of the largest population that may be drawn, the other
        hyperparameters being those of the base."""
        searched, own = self.space.build(self.agents).get("nes.population_size"), self.base.nes
        ends = (getattr(searched, name, own.population_size) for name in ("upper", "value"))
        largest = max(map(int, (*ends, *getattr(searched, "choices", ()))))
        return replace(own, population_size=largest).evaluations

    @cached_property
    def search_seed(self) -> int:
        """The seed from which proposals and runs are derived: the study's own, unless its prior is
        another study. That one may have the same seed, and would be repeated."""
        if self.prior in PRIORS:
            return self.seed
        of_prior = int(checksum(self.prior.encode())[:8], 16)
        return derive(self.seed, Purpose.CONTINUATION, of_prior)

    def run(
        self,
        config_id: ConfigId,
        configuration: Configuration,
        number: int,
        validation: bool = False,
    ) -> NESRun:
        """A configuration's NES run with that number, from 0, of the search or of its validation.

        The seed is derived from the study's, the configuration's id and the number, so that no
        configuration owes its result to a start that others have too. Raises InvalidInput for a
        configuration that is not allowed.
        """
        hp = to_hyperparameters(self.base, configuration)
        kind, purpose = (
            ("validation", Purpose.VALIDATION) if validation else ("run", Purpose.CONFIGURATION)
        )
        name = configuration_name(config_id)
        folder = self.folder / "configurations" / name / f"{kind}-{number}"
        seed = derive(self.search_seed, purpose, *config_id, number)
        return NESRun(self.task, hp, seed, folder)

    def recipe_text(self, config_id: ConfigId, configuration: Configuration) -> str:
        """The recipe file of a configuration: the one that its runs had."""
        heading = f"Found by the study {self.name!r}: configuration {configuration_name(config_id)}"
        return recipe_text(to_hyperparameters(self.base, configuration), heading)

    @cached_property
    def prior_configuration(self) -> Configuration | None:
        """The configuration that the search begins with, if its prior is the recipe: the recipe's
        values, moved into the space where they lie outside. Raises InvalidInput if the space
        forbids it."""
        if self.prior != "recipe":
            return None
        from search_spaces.prior import nearest  # with ConfigSpace, which trials do without

        try:
            return nearest(self.space.build(self.agents), self.of_recipe)
        except InvalidInput as error:
            told = f"the search would begin with its recipe (not with --prior none): {error}"
            raise InvalidInput(told) from None

    @property
    def moved(self) -> dict[str, tuple[Any, Any]]:
        """The recipe's values outside of the space, and those that the search begins with."""
        begun = self.prior_configuration or {}
        return {
            name: (self.of_recipe[name], value)
            for name, value in begun.items()
            if value != self.of_recipe[name]
        }

    @cached_property
    def of_recipe(self) -> Configuration:
        """The recipe's values in the dimensions of the space, in which they may lie outside."""
        values = of_hyperparameters(self.base, self.space.build(self.agents))
        if values.get("se.step_limit") == 0:  # which stands for
            values["se.step_limit"] = self.task.step_limit
        return values

    @property
    def earlier(self) -> Journal | None:
        """The results that the model begins with, once they are taken over."""
        return None if self.prior in PRIORS else Journal(self.folder / _EARLIER)

    def check_prior(self) -> None:
        """Raise InvalidInput if the prior is a study that has no results for this one's model, or
        the recipe and the space forbids it."""
        if self.prior_configuration is not None:  # which the space allows
            return
        if self.prior in PRIORS or (self.folder / _EARLIER).exists():
            return
        if self.method != "bohb":
            raise InvalidInput(
                f"the study {self.prior!r} cannot be the prior of the method {self.method!r}: only "
                "bohb has a model that begins with results"
            )
        folder = self.folder.parent / self.prior
        if not (folder / SETTINGS_FILE).exists():
            allowed = (*PRIORS, "and studies on the same task")
            raise one_of("prior", self.prior, allowed)
        other = Study.read(folder)
        if other.stored_space() != self.space.build(self.agents):
            raise InvalidInput(
                f"the study {self.prior!r} cannot be the prior: it searched another space"
            )
        budgets = self.schedule.budgets
        if not any(line.budget in budgets for line in Journal(folder).results):
            raise InvalidInput(
                f"the study {self.prior!r} cannot be the prior: it has no results at the budgets "
                f"{', '.join(map(str, budgets))}"
            )

    @property
    def unlike_prior(self) -> list[str]:
        """Settings in which the study that is the prior differs from this one, in words: its
        objectives may then be others. None once its results are taken over. Raises InvalidInput if
        it is damaged."""
        folder = self.folder.parent / self.prior
        if self.prior in PRIORS or (self.folder / _EARLIER).exists():
            return []
        theirs, ours = (
            {"task": asdict(study.task), **study.base.to_dict()}
            for study in (Study.read(folder), self)
        )
        searched = self.space.searched(self.agents)
        found = [
            (name.removeprefix("agents."), then, now)
            for name, then, now in differences(theirs, ours)
        ]
        return [
            f"{name} {then}, not {now}"
            for name, then, now in found
            if name != "recipe" and name not in searched
        ]

    def take_over_prior(self) -> None:
        """Copy the results of the study that is the prior, once. So this study stays the same
        whatever becomes of that one. Raises InvalidInput, and StorageFailure."""
        self.check_prior()
        if self.prior in PRIORS or (self.folder / _EARLIER).exists():
            return
        journal = Journal(self.folder.parent / self.prior)
        copy = self.folder / f".{_EARLIER}"
        # A study under way writes configurations before their results.
        for path in reversed(journal.paths):
            write_aside(copy / path.name, path.read_bytes())
        copy.replace(self.folder / _EARLIER)

    def write_space(self) -> None:
        """Write SPACE_FILE. Raises StorageFailure, and InvalidInput if the study was begun with
        other ranges: those of this package's spaces may change from one version to the next."""
        path, space = self.folder / SPACE_FILE, self.space.build(self.agents)
        if path.exists() and Space.of(str(path)).build() != space:
            raise InvalidInput(
                f"study {self.name!r} was begun with other ranges of the search space "
                f"{self.space.name!r} than this version has: begin another one with --study NAME "
                f"(and --space {path}, for the old ranges)"
            )
        write_aside(path, json.dumps(space.to_serialized_dict(), indent=2).encode())

    def stored_space(self) -> "ConfigurationSpace":
        """The space with the ranges that it was begun with, which are its own also where this
        version's has others. Raises InvalidInput if its file is damaged."""
        path = self.folder / SPACE_FILE
        return Space.of(str(path)).build() if path.exists() else self.space.build(self.agents)

    def settings(self) -> dict[str, Any]:
        """Its settings."""
        return {
            **settings_of(KIND, self.task, self.seed, self.agents),
            "space": self.space.name if self.space.content is None else asdict(self.space),
            "method": self.method,
            "prior": self.prior,
            "budgets": list(self.schedule.budgets),
            "cycle": self.schedule.cycle,
            "base": self.base.to_dict(),
            **({} if self.search_seed == self.seed else {"search_seed": self.search_seed}),
        }

    @classmethod
    def schedule_in(cls, folder: Path) -> Schedule:
        """The schedule of the study in a folder, whose agents need not be known here. Raises
        InvalidInput."""
        damaged = f"{str(folder)!r} holds no study"
        settings = decode(_Settings, read_settings(folder), damaged)
        return Schedule(settings.budgets, settings.cycle)

    @classmethod
    def read(cls, folder: Path) -> "Study":
        """The study in a folder. Raises InvalidInput."""
        damaged = f"{str(folder)!r} holds no study"
        settings = decode(_Settings, read_settings(folder), damaged)
        try:
            given = settings.space
            if isinstance(given, str) and given not in SPACES:
                raise one_of("search space", given, SPACES)
            space = given if isinstance(given, Space) else Space(given)
            return cls(
                folder,
                settings.task,
                settings.seed,
                space,
                Schedule(settings.budgets, settings.cycle),
                settings.base.checked(),
                get_method(settings.method),
                settings.prior,
            )
        except InvalidInput as error:
            raise InvalidInput(f"{damaged}: {error}") from None
