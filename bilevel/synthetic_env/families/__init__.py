"""Families of SEs: what NES searches, and how a random SE is drawn.

A family decodes a *genotype* (D,), the vector that NES moves, into the parameters psi (P,) of
three plain MLPs.

name         genotype
----------   -----------------------------------------------------------------------------
plain        psi itself, initialised uniformly in +-1/sqrt(fan_in) (the paper's)
exogenous    a hand-designed subset: next states ignore the action, rewards compare actions
one-step     the reward network of SEs with episodes of one step

A new family takes one module with a class that implements `Family`, and one line in `_FAMILIES`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bilevel.evolution import Genotype, SearchDistribution
from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env.architecture import SE, Architecture, Psi
from bilevel.synthetic_env.families.exogenous import ExogenousFamily
from bilevel.synthetic_env.families.one_step import OneStepFamily
from bilevel.tasks import ObservationScale, Task

__all__ = ["Family", "SEDistribution", "family_of"]


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


@dataclass(frozen=True)
class PlainFamily:
    """The paper's family: a genotype is psi, all weights and biases of the three MLPs."""

    architecture: Architecture

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


_FAMILIES: dict[str, Callable[[Architecture, ObservationScale, SEHyperparameters], Family]] = {
    "plain": lambda architecture, scale, hp: PlainFamily(architecture),
    "exogenous": ExogenousFamily.build,
    "one-step": OneStepFamily.build,
}


def family_of(task: Task, hp: SEHyperparameters, scale: ObservationScale) -> Family:
    """Return the family `hp.family` for a task whose observations have this scale. Raises
    InvalidInput for networks that cannot hold the family."""
    return _FAMILIES[hp.family](Architecture.of(task, hp), scale, hp)


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
