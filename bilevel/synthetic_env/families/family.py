"""The interface of a family of SEs."""

from typing import Protocol

import numpy as np

from bilevel.evolution import Genotype
from bilevel.synthetic_env.architecture import Architecture, Psi


class Family(Protocol):
    """A set of SEs of one architecture, indexed by genotypes (D,)."""

    @property
    def architecture(self) -> Architecture:
        """Architecture of the SEs."""

    @property
    def size(self) -> int:
        """Length D of a genotype."""

    def initialize(self, rng: np.random.Generator) -> Genotype:
        """Draw the genotype (D,) of a random SE."""

    def psi(self, genotype: Genotype) -> Psi:
        """Decode a genotype (D,) into the parameters (P,) of an SE."""
