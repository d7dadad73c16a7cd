"""The tables of docs/tuning.md."""

from collections.abc import Callable

from benchmarks.search import comparison, recipes, studies

TABLES: dict[str, Callable[[], str]] = {
    "search": comparison.methods,
    "largest-budget": comparison.largest_budget,
    "incumbents": comparison.incumbents,
    "noise": comparison.noise,
    "searches": studies.searches,
    "proposals": studies.proposals,
    "validations": studies.validations,
    "found": recipes.found,
    "found-taught": recipes.found_taught,
}
