"""The search distribution of NES over SEs."""

from dataclasses import dataclass

import numpy as np

from bilevel.evolution import Genotype, SearchDistribution
from bilevel.synthetic_env.architecture import SE
from bilevel.synthetic_env.families import Family


@dataclass(frozen=True)
class SEDistribution:
    """A family of SEs, and a search distribution over its genotypes."""

    family: Family
    search: SearchDistribution

    @property
    def centre(self) -> SE:
        """The unperturbed SE, at the moving average of the means."""
        return self.at(self.search.average)

    def at(self, genotype: Genotype) -> SE:
        """Return the SE of a genotype (D,)."""
        return SE(self.family.architecture, self.family.psi(genotype))

    def perturbed(self, seed: int, sign: int) -> SE:
        """Return the SE at mean + sign * eps, with eps drawn from `seed`."""
        return self.at(self.search.sample(seed, sign))

    def random(self, seed: int) -> SE:
        """Return a random SE of the family."""
        return self.at(self.family.initialize(np.random.default_rng(seed)))
