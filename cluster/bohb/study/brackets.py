"""Which configurations get how much core time: brackets of successive halving.

symbol   meaning
------   ---------------------------------------------------------------
eta      a rung keeps one configuration in eta, for eta times the budget
rungs    length of the budget ladder
s        rungs of a bracket above its first
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from bilevel.errors import InvalidInput

ETA = 3


@dataclass(frozen=True)
class Rung:
    """A stage of a bracket: `configurations` configurations have spent `budget` core seconds."""

    bracket: int
    budget: int
    configurations: int


def budget_ladder(smallest: int, largest: int) -> list[int]:
    """Budgets in core seconds, ascending: `largest` divided by powers of eta
    (rounded), down to `smallest`.

    Powers are multiplied up, because the rounding of a logarithm can lose a rung.
    Raises InvalidInput unless 1 <= smallest <= largest.
    """
    if not 1 <= smallest <= largest:
        raise InvalidInput(
            f"budgets must satisfy 1 <= smallest <= largest; got {smallest} and {largest}"
        )
    ladder = []
    power = 1
    while (budget := round(largest / power)) >= smallest:
        ladder.append(budget)
        power *= ETA
    return ladder[::-1]


@dataclass(frozen=True)
class Schedule:
    """Brackets of successive halving on one ladder, and their order.

    Raises InvalidInput for a cycle that is longer than the ladder.
    """

    budgets: tuple[int, ...]  # core seconds, ascending
    #: Number of kinds of brackets, which take turns, beginning with the smallest first budget. In
    #: Hyperband there is one kind per budget; with 1 all brackets begin at the smallest budget.
    cycle: int

    def __post_init__(self) -> None:
        if not 1 <= self.cycle <= len(self.budgets):
            raise InvalidInput(
                f"a cycle of brackets must be 1 to {len(self.budgets)} (the budgets "
                f"{list(self.budgets)}); got {self.cycle}"
            )

    @classmethod
    def of(cls, method: str, smallest: int, largest: int, cycle: int | None = None) -> Self:
        """The schedule of a search method; random search has the largest budget alone.

        `cycle` None means Hyperband's. Raises InvalidInput as `budget_ladder` does.
        """
        budgets = budget_ladder(largest if method == "random" else smallest, largest)
        return cls(tuple(budgets), min(cycle or len(budgets), len(budgets)))

    def bracket(self, number: int) -> list[Rung]:
        """The rungs of a bracket (Li et al., 2018; sizes as hpbandster computes them)."""
        rungs = len(self.budgets)
        s = rungs - 1 - number % self.cycle
        first = rungs // (s + 1) * ETA**s
        return [
            Rung(number, budget, max(first // ETA**rung, 1))
            for rung, budget in enumerate(self.budgets[-s - 1 :])
        ]

    def brackets(self, count: int) -> list[Rung]:
        """All rungs of the first `count` brackets."""
        return [rung for number in range(count) for rung in self.bracket(number)]


def configurations_to_begin(rungs: list[Rung]) -> int:
    """Number of configurations in the lowest rungs; the other rungs continue some of them."""
    begun = {rung.bracket: rung.configurations for rung in reversed(rungs)}
    return sum(begun.values())


def core_seconds_to_run(rungs: Sequence[Rung]) -> int:
    """Core seconds that these rungs cost; promoted configurations continue from their lower
    rung."""
    reached: dict[int, int] = {}
    total = 0
    for rung in rungs:
        total += rung.configurations * (rung.budget - reached.get(rung.bracket, 0))
        reached[rung.bracket] = rung.budget
    return total
