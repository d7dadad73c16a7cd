"""Brackets of successive halving: how many configurations get which budget."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

#: A rung promotes one configuration in ETA, to ETA times the budget.
ETA = 3


@dataclass(frozen=True)
class Rung:
    """A stage of a bracket: `configurations` configurations run until they spent `budget` core
    seconds."""

    bracket: int
    budget: int
    configurations: int


@dataclass(frozen=True)
class Schedule:
    """The budgets of a study and the order of its brackets."""

    budgets: tuple[int, ...]  # core seconds, ascending
    #: Number of kinds of brackets, which alternate and start with the smallest first budget.
    #: Hyperband has one kind per budget; with 1, all brackets start at the smallest budget.
    cycle: int

    @classmethod
    def of(cls, method: str, smallest: int, largest: int, cycle: int | None = None) -> Self:
        """Return the schedule of a method, by default with Hyperband's cycle.

        Budgets are `largest` divided by powers of ETA, rounded, down to `smallest`. Random search
        has only the largest one.
        """
        budgets = [largest]
        while method != "random" and (budget := round(largest / ETA ** len(budgets))) >= smallest:
            budgets.insert(0, budget)
        return cls(tuple(budgets), min(cycle or len(budgets), len(budgets)))

    def bracket(self, number: int) -> list[Rung]:
        """Return the rungs of a bracket (Li et al., 2018), with the sizes that hpbandster uses."""
        above = len(self.budgets) - 1 - number % self.cycle  # rungs above the first
        first = len(self.budgets) // (above + 1) * ETA**above
        return [
            Rung(number, budget, max(first // ETA**rung, 1))
            for rung, budget in enumerate(self.budgets[-above - 1 :])
        ]

    def brackets(self, count: int) -> list[Rung]:
        """Return all rungs of the first `count` brackets."""
        return [rung for number in range(count) for rung in self.bracket(number)]


def initial_configurations(rungs: Sequence[Rung]) -> int:
    """Return the number of configurations in the lowest rung of each bracket."""
    return sum({rung.bracket: rung.configurations for rung in reversed(rungs)}.values())


def core_seconds_to_run(rungs: Sequence[Rung]) -> int:
    """Return the core seconds of these rungs, in which promoted configurations continue."""
    reached: dict[int, int] = {}
    total = 0
    for rung in rungs:
        total += rung.configurations * (rung.budget - reached.get(rung.bracket, 0))
        reached[rung.bracket] = rung.budget
    return total
