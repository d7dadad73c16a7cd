"""Conditions: the ways in which the experiments' SEs are learned (docs/experiments.md)."""

from dataclasses import dataclass, replace

from bilevel.hyperparameters import Hyperparameters
from bilevel.hyperparameters.definitions import Variation
from bilevel.recipes import load_recipe
from bilevel.tasks import Task
from cluster.experiments.sizes import Size
from cluster.nes.run import NESRun
from cluster.storage.home import Home


@dataclass(frozen=True)
class Condition:
    """A recipe and the variation of its agents."""

    name: str
    recipe: str
    title: str  # in pictures and tables
    vary: Variation | None = None  # None: the recipe's

    def vary_at(self, size: Size) -> Variation | None:
        """Return the variation of agents during NES. `narrowed`, which replaces large agents by
        narrow ones that learn at the same pace, becomes `all` in the size `paper`."""
        return "all" if self.vary == "narrowed" and size.name == "paper" else self.vary

    def hyperparameters(self, task: Task, size: Size) -> Hyperparameters:
        """Return the hyperparameters of the NES runs."""
        hp = load_recipe(self.recipe, task)
        return size.shortened(replace(hp, vary_agent=self.vary_at(size) or hp.vary_agent))

    def label(self, size: Size) -> str:
        """Return a part of the run names that differs wherever the hyperparameters do."""
        return f"{self.name}-{self.vary_at(size)}" if self.vary == "narrowed" else self.name

    def run(self, task: Task, size: Size, seed: int, home: Home) -> NESRun:
        """Return the NES run with that seed, which all experiments of the task share."""
        folder = home.run_folder(task.id, f"{size.prefix}{self.label(size)}-seed{seed}")
        return NESRun(task, self.hyperparameters(task, size), seed, folder)


CONDITIONS = {
    condition.name: condition
    for condition in (
        Condition("default", "exogenous", "SE, our recipe"),
        Condition("varied", "exogenous", "SE, HP varied", "narrowed"),
        Condition("fixed", "exogenous", "SE, HP fixed", "no"),
        Condition("authors", "authors", "authors' rule"),
        Condition("paper", "paper", "Algorithm 1"),
    )
}

#: The source that is not a condition: the real task.
REAL = "real"


def title_of(source: str) -> str:
    """Return the title of a condition, or of the real task."""
    return "real task" if source == REAL else CONDITIONS[source].title
