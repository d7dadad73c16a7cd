"""The paper's family: the genotype is psi."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from bilevel.evolution import Genotype
from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env.architecture import Architecture, Psi
from bilevel.tasks import ObservationScale


@dataclass(frozen=True)
class PlainFamily:
    """All weights and biases of the three MLPs."""

    architecture: Architecture

    @classmethod
    def build(
        cls, architecture: Architecture, scale: ObservationScale, hp: SEHyperparameters
    ) -> Self:
        """Return the family, which uses only the architecture."""
        return cls(architecture)

    @property
    def size(self) -> int:
        """P."""
        return self.architecture.parameter_count

    def initialize(self, rng: np.random.Generator) -> Genotype:
        """Draw weights and biases uniformly in +-1/sqrt(fan_in)."""
        return self.architecture.initialize(rng)

    def psi(self, genotype: Genotype) -> Psi:
        """Return the genotype."""
        return genotype
