"""Conditions: the ways in which the experiments' SEs are learned.

name        recipe      agents of NES               shown as
---------   ---------   -------------------------   ---------------------------------------------
default     default     the recipe's                ours
varied      default     drawn from all ranges (*)   the paper's "HP: varied"
fixed       default     always the same             the paper's "HP: fixed"
authors     authors     the recipe's                the rule of the authors' code
paper       paper       the recipe's                Algorithm 1 as printed
distilled   distilled   the recipe's                the supervised baseline, which is no NES

(*) `narrowed`, which replaces large agents by narrow ones that learn at the same pace, in all sizes
but `paper`, which draws `all`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from bilevel.hyperparameters import Hyperparameters, load_recipe
from bilevel.hyperparameters.definitions import Variation
from bilevel.tasks import Task
from cluster.experiments.sizes import Size
from cluster.nes.run import NESRun
from cluster.storage.home import Home


@dataclass(frozen=True)
class Condition:
    """A recipe and the variation of its agents; None: the recipe's."""

    name: str
    recipe: str
    vary: Variation | None = None
    vary_at_paper_size: Variation | None = None
    title: str = ""  # in pictures and tables

    def vary_at(self, size: Size) -> Variation | None:
        """The variation of agents during NES."""
        at_paper = self.vary_at_paper_size if size.name == "paper" else None
        return at_paper or self.vary

    def hyperparameters(self, task: Task, size: Size) -> Hyperparameters:
        """The hyperparameters of this condition's NES runs."""
        hp = load_recipe(self.recipe, task)
        return size.shortened(replace(hp, vary_agent=self.vary_at(size) or hp.vary_agent))

    def label(self, size: Size) -> str:
        """Part of the names of its runs; differs wherever the hyperparameters do."""
        varied = f"-{self.vary_at(size)}" if self.vary_at_paper_size else ""
        return f"{self.name}{varied}"

    def run(self, task: Task, size: Size, seed: int, home: Home) -> NESRun:
        """The NES run with that seed, which all experiments of the task share."""
        folder: Path = home.run_folder(task.id, f"{size.prefix}{self.label(size)}-seed{seed}")
        return NESRun(task, self.hyperparameters(task, size), seed, folder)


CONDITIONS = {
    condition.name: condition
    for condition in (
        Condition("default", "default", title="SE, our recipe"),
        Condition("varied", "default", "narrowed", "all", title="SE, HP varied"),
        Condition("fixed", "default", "no", title="SE, HP fixed"),
        Condition("authors", "authors", title="authors' rule"),
        Condition("paper", "paper", title="Algorithm 1"),
        Condition("distilled", "distilled", title="SE, distilled"),
    )
}

#: The source that is no condition: the real task.
REAL, REAL_TITLE = "real", "real task"


def title_of(source: str) -> str:
    """Title of a condition, or of the real task."""
    return REAL_TITLE if source == REAL else CONDITIONS[source].title
