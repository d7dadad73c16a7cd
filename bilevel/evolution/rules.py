"""Update rules by name: how fitness is shaped, how the gradient is estimated, and the step size.

rule          weights w_i                                      gradient g        step
-----------   ----------------------------------------------   ---------------   -------------
nes           u_i+ - u_i-, u: NES utilities of all 2n ranks    sum_i w_i z_i     alpha sigma g
antithetic    u_i+ - u_i-, u: centred ranks of all 2n          mean_i w_i z_i    alpha g
paper         transformed scores                               mean_i w_i z_i    alpha g
authors       transformed scores                               sum_i w_i z_i     alpha sigma g

With eps_i = sigma z_i, the steps are alpha sum_i w_i eps_i and alpha / (n sigma) sum_i w_i eps_i.

`nes` is the natural gradient in the mean with rank utilities and a fixed sigma (Wierstra et al.,
2014, "Natural Evolution Strategies"). `antithetic` is the estimator of Salimans et al. (2017).

`paper` is the update that the paper prints. The authors' code does not divide by n sigma
(`authors`), and they tuned the step size of their tables for the undivided rule. Both rules use the
authors' mirrored sampling, which keeps only the better member of each pair.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bilevel.evolution.shaping import centred_rank, finite, transform, utilities
from bilevel.evolution.strategy import Fitness, Genotype, Scores


def weighted_sum(w: Scores, z: Genotype) -> Scores:
    """Return sum_i w_i z_i (D,)."""
    gradient: Scores = w @ z
    return gradient


def weighted_mean(w: Scores, z: Genotype) -> Scores:
    """Return mean_i w_i z_i (D,)."""
    gradient: Scores = (w @ z) / len(z)
    return gradient


def pair_utilities(fitness: Fitness, score_transform: str, ties: str) -> Scores:
    """Return the differences (n,) of the NES utilities of each mirrored pair."""
    plus, minus = np.split(utilities(_members(fitness)), 2)
    return plus - minus


def pair_ranks(fitness: Fitness, score_transform: str, ties: str) -> Scores:
    """Return the differences (n,) of the centred ranks of each mirrored pair."""
    plus, minus = np.split(centred_rank(_members(fitness)), 2)
    return plus - minus


def better_sign(fitness: Fitness, score_transform: str, ties: str) -> Scores:
    """Return the transformed score (n,) of the better member of each pair, with its sign."""
    assert fitness.centre is not None
    average = float(finite(fitness.centre).mean())
    if fitness.minus is None:
        return transform(score_transform, fitness.plus, average, ties)
    plus, minus = np.split(_members(fitness), 2)
    sign = np.where(minus > plus, -1.0, 1.0)
    return sign * transform(score_transform, np.maximum(plus, minus), average, ties)


def _members(fitness: Fitness) -> Scores:
    """Return the finite scores (2n,) of all members."""
    assert fitness.minus is not None
    return finite(np.concatenate([fitness.plus, fitness.minus]))


@dataclass(frozen=True)
class Rule:
    """An update rule: a shaping function of (fitness, transform, ties), and a gradient estimate.
    It either `transforms` scores by `nes.score_transform`, or ranks mirrored pairs."""

    shape: Callable[[Fitness, str, str], Scores]
    estimate: Callable[[Scores, Genotype], Scores]
    transforms: bool

    def step_size(self, alpha: float, sigma: float) -> float | np.float32:
        """Return the factor between gradient and step."""
        # In float32, like genotypes.
        return alpha * np.float32(sigma) if self.estimate is weighted_sum else alpha


RULES = {
    "nes": Rule(pair_utilities, weighted_sum, transforms=False),
    "antithetic": Rule(pair_ranks, weighted_mean, transforms=False),
    "paper": Rule(better_sign, weighted_mean, transforms=True),
    "authors": Rule(better_sign, weighted_sum, transforms=True),
}
