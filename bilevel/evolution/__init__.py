"""An evolution strategy, independent of synthetic environments."""

from bilevel.evolution.rules import RULES, Rule
from bilevel.evolution.strategy import (
    EvolutionStrategy,
    Fitness,
    Genotype,
    SearchDistribution,
)

__all__ = [
    "RULES",
    "EvolutionStrategy",
    "Fitness",
    "Genotype",
    "Rule",
    "SearchDistribution",
]
