"""Brackets of successive halving: how many configurations get which budget.

symbol   meaning
------   ------------------------------------------------------------------
eta      a rung promotes one configuration in eta, to eta times the budget
rungs    number of budgets
s        number of rungs of a bracket above its first
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from bilevel.errors import InvalidInput

ETA = 3


@dataclass(frozen=True)
class Rung:
    """A stage of a bracket: `configurations` configurations run until they spent `budget` core
    seconds."""

    bracket: int
    budget: int
    configurations: int


def budget_ladder(smallest: int, largest: int) -> list[int]:
    """Return budgets in core seconds, ascending: `largest` divided by powers of eta, rounded, down
    to `smallest`. Raises InvalidInput unless 1 <= smallest <= largest."""
    if not 1 <= smallest <= largest:
        raise InvalidInput(
            f"budgets must satisfy 1 <= smallest <= largest; got {smallest} and {largest}"
        )
    ladder = []
    power = 1  # multiplied, because a rounded logarithm can lose a rung
    while (budget := round(largest / power)) >= smallest:
        ladder.append(budget)
        power *= ETA
    return ladder[::-1]


@dataclass(frozen=True)
class Schedule:
    """The budgets of a study and the order of its brackets. Raises InvalidInput for a cycle that
    is longer than the list of budgets."""

    budgets: tuple[int, ...]  # core seconds, ascending
    #: Number of kinds of brackets, which alternate and start with the smallest first budget.
    #: Hyperband has one kind per budget; with 1, all brackets start at the smallest budget.
    cycle: int

    def __post_init__(self) -> None:
        if not 1 <= self.cycle <= len(self.budgets):
            raise InvalidInput(
                f"a cycle of brackets must be 1 to {len(self.budgets)} (the budgets "
                f"{list(self.budgets)}); got {self.cycle}"
            )

    @classmethod
    def of(cls, method: str, smallest: int, largest: int, cycle: int | None = None) -> Self:
        """Return the schedule of a method; random search has only the largest budget.

        The default cycle is Hyperband's. Raises InvalidInput for invalid budgets.
        """
        budgets = budget_ladder(largest if method == "random" else smallest, largest)
        return cls(tuple(budgets), min(cycle or len(budgets), len(budgets)))

    def bracket(self, number: int) -> list[Rung]:
        """Return the rungs of a bracket (Li et al., 2018), with the sizes that hpbandster uses."""
        rungs = len(self.budgets)
        s = rungs - 1 - number % self.cycle
        first = rungs // (s + 1) * ETA**s
        return [
            Rung(number, budget, max(first // ETA**rung, 1))
            for rung, budget in enumerate(self.budgets[-s - 1 :])
        ]

    def brackets(self, count: int) -> list[Rung]:
        """Return all rungs of the first `count` brackets."""
        return [rung for number in range(count) for rung in self.bracket(number)]


def initial_configurations(rungs: Sequence[Rung]) -> int:
    """Return the number of configurations in the lowest rung of each bracket."""
    first = {rung.bracket: rung.configurations for rung in reversed(rungs)}
    return sum(first.values())


def core_seconds_to_run(rungs: Sequence[Rung]) -> int:
    """Return the core seconds of these rungs, in which promoted configurations continue."""
    reached: dict[int, int] = {}
    total = 0
    for rung in rungs:
        total += rung.configurations * (rung.budget - reached.get(rung.bracket, 0))
        reached[rung.bracket] = rung.budget
    return total
