"""An evolution strategy: sample, shape, step (paper, Algorithm 1, without agents and SEs).

symbol    shape    meaning
-------   ------   --------------------------------------------------------------------
D, n      -        length of a genotype, population size n_p
mean      (D,)     mean of the search distribution N(mean, sigma^2 I)
z         (n, D)   standard normal noise, one seed per member; eps_i = sigma z_i
F         (n,)     fitness of mean + eps_i (`plus`) and mean - eps_i (`minus`)
w         (n,)     shaped fitness

    strategy = EvolutionStrategy(sigma, shape, estimate, optimize)
    distribution = strategy.init(genotype)
    for generation in range(n_o):
        seeds = [...]                                       # one per member
        plus, minus = strategy.ask(distribution, seeds)
        fitness = Fitness(evaluate(plus), evaluate(minus))
        distribution, step = strategy.tell(distribution, seeds, fitness)

A seed and a sign identify a member, so that a distributed evaluation needs two integers per member.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: The vector (D,) that an evolution strategy moves.
Genotype = NDArray[np.float32]
Scores = NDArray[np.float64]


@dataclass(frozen=True)
class SearchDistribution:
    """N(mean, sigma^2 I), with a moving average of past means, which are noisy (Polyak and
    Juditsky, 1992). Without averaging it equals the mean."""

    mean: Genotype  # (D,)
    average: Genotype  # (D,)
    sigma: float

    def noise(self, seed: int) -> Genotype:
        """Return standard normal z (D,), which depends on `seed` only."""
        return np.random.default_rng(seed).standard_normal(self.mean.size, np.float32)

    def sample(self, seed: int, sign: int) -> Genotype:
        """Return mean + sign * eps (D,), with eps = sigma * z drawn from `seed`."""
        return self.mean + np.float32(sign) * np.float32(self.sigma) * self.noise(seed)


@dataclass(frozen=True)
class Fitness:
    """Fitness of the n members of a generation."""

    plus: Scores  # (n,) of mean + eps
    minus: Scores | None = None  # (n,) of mean - eps; None without mirrored sampling
    centre: Scores | None = None  # (m,) of the unperturbed genotype, a baseline for some rules


@dataclass(frozen=True)
class EvolutionStrategy:
    """Stochastic gradient ascent on the expected fitness of a search distribution.

    `shape` maps fitness to weights w (n,), `estimate` (w, z) to a gradient (D,), `optimize` a
    gradient to a step (D,). `averaging` is the share of the average that a generation keeps.
    """

    sigma: float
    shape: Callable[[Fitness], Scores]
    estimate: Callable[[Scores, Genotype], Scores]
    optimize: Callable[[Scores], Genotype]
    averaging: float = 0.0

    def init(self, genotype: Genotype) -> SearchDistribution:
        """Centre the search distribution on `genotype` (D,)."""
        return SearchDistribution(genotype, genotype, self.sigma)

    def ask(
        self, distribution: SearchDistribution, seeds: Sequence[int]
    ) -> tuple[Genotype, Genotype]:
        """Return the members mean + eps (n, D) and mean - eps (n, D)."""
        plus, minus = (
            np.stack([distribution.sample(seed, sign) for seed in seeds]) for sign in (1, -1)
        )
        return plus, minus

    def tell(
        self, distribution: SearchDistribution, seeds: Sequence[int], fitness: Fitness
    ) -> tuple[SearchDistribution, Genotype]:
        """Return the distribution after one step, and the step (D,)."""
        z = np.stack([distribution.noise(seed) for seed in seeds])
        w = self.shape(fitness)
        gradient = self.estimate(w, z)
        step = self.optimize(gradient)
        mean = distribution.mean + step
        kept = np.float32(self.averaging)
        average = kept * distribution.average + (1 - kept) * mean
        return SearchDistribution(mean, average, self.sigma), step
