"""Which configurations run for how many generations: Hyperband's brackets.

symbol   meaning
------   ---------------------------------------------------------------
eta      a rung keeps one configuration in eta, for eta times the budget
rungs    length of the budget ladder
s        rungs of a bracket above its first
"""

from dataclasses import dataclass

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


def budgets_of(method: str, smallest: int, largest: int) -> list[int]:
    """The ladder of a search method; random search has the largest budget alone. Raises
    InvalidInput as `budget_ladder` does."""
    return budget_ladder(largest if method == "random" else smallest, largest)


def bracket_rungs(bracket: int, ladder: list[int]) -> list[Rung]:
    """The rungs of bracket number `bracket` (Li et al., 2018; sizes as hpbandster
    computes them): brackets cycle from the most to the least eager to halve."""
    s = len(ladder) - 1 - bracket % len(ladder)
    first = len(ladder) // (s + 1) * ETA**s
    return [
        Rung(bracket, budget, max(first // ETA**rung, 1))
        for rung, budget in enumerate(ladder[-s - 1 :])
    ]


def bracket_table(brackets: int, ladder: list[int]) -> list[Rung]:
    """All rungs of the first `brackets` brackets."""
    return [rung for bracket in range(brackets) for rung in bracket_rungs(bracket, ladder)]


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
