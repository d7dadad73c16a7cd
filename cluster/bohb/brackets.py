"""Which configurations run for how many generations: brackets of successive halving.

symbol   meaning
------   ---------------------------------------------------------------
eta      a rung keeps one configuration in eta, for eta times the budget
rungs    length of the budget ladder
s        rungs of a bracket above its first
"""

from dataclasses import dataclass
from typing import Self

from bilevel.errors import InvalidInput

ETA = 3


@dataclass(frozen=True)
class Rung:
    """`configurations` of them run until they have `budget` generations."""

    bracket: int
    budget: int
    configurations: int


def budget_ladder(smallest: int, largest: int) -> list[int]:
    """Budgets in generations, ascending: `largest` divided by powers of eta
    (rounded), as long as at least `smallest`.

    Powers are multiplied up, not taken from a logarithm, whose rounding can lose a
    rung. Raises InvalidInput unless 1 <= smallest <= largest.
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
    """Brackets of successive halving on one ladder, and in which order they come.

    Raises InvalidInput for a cycle that is longer than the ladder.
    """

    budgets: tuple[int, ...]  # generations, ascending
    #: Brackets come in turn, from the most to the least eager to halve, so many kinds of them:
    #: in Hyperband one for each budget that may be the first. With 1 all begin at the smallest.
    cycle: int

    def __post_init__(self) -> None:
        if not 1 <= self.cycle <= len(self.budgets):
            raise InvalidInput(
                f"a cycle of brackets must be 1 to {len(self.budgets)} (the budgets "
                f"{list(self.budgets)}); got {self.cycle}"
            )

    @classmethod
    def of(cls, method: str, smallest: int, largest: int, cycle: int | None = None) -> Self:
        """That of a search method: random search has the largest budget alone; `cycle` is
        Hyperband's if it is None. Raises InvalidInput as `budget_ladder` does."""
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
    """Those of every bracket's lowest rung; its other rungs go on with these."""
    begun = {rung.bracket: rung.configurations for rung in reversed(rungs)}
    return sum(begun.values())


def generations_to_run(rungs: list[Rung]) -> int:
    """Generations that these rungs cost, when promoted configurations continue from
    where their lower rung ended."""
    reached: dict[int, int] = {}
    total = 0
    for rung in rungs:
        total += rung.configurations * (rung.budget - reached.get(rung.bracket, 0))
        reached[rung.bracket] = rung.budget
    return total
