"""UpdateSE (paper, Algorithm 1): update rules, by name, that turn the members' scores into a step.

symbol   shape     meaning
------   -------   ----------------------------------------------------------
theta    (D,)      coordinates of the unperturbed SE (in the paper psi itself)
sigma    (D,)      standard deviation of perturbations, one number in the paper
z        (n, D)    standard normal; eps = sigma * z
F        (n,)      scores of theta + eps (`plus`) and theta - eps (`minus`)
n_p      -         population size n

rule          theta + ...
-----------   -------------------------------------------------------------------
snes          alpha * sigma * sum_i (u_i+ - u_i-) z_i, u the utilities of the ranks of all 2n
              scores: separable NES (Schaul et al., 2011), with fixed sigma
antithetic    alpha * mean_i (u_i+ - u_i-) z_i, u the centred ranks of all 2n scores: the
              textbook estimator (Salimans et al., 2017)
paper         alpha / (n_p sigma) * sum_i w_i eps_i = alpha * mean_i w_i z_i
authors       alpha * sum_i w_i eps_i: the authors' code, which does not divide

In the last two rules, w are the transformed scores, and mirrored sampling is the authors': the
better sign of each pair is kept with its score, and the other is dropped.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import NESHyperparameters
from bilevel.nes.transforms import centred_rank, finite, transform, utilities

Scores = NDArray[np.float64]


@dataclass(frozen=True)
class MemberScores:
    """Scores of one generation, for n members."""

    centre: Scores  # (m,) agents trained on the unperturbed SE
    plus: Scores  # (n,)
    minus: Scores | None  # (n,), None without mirrored sampling


@dataclass(frozen=True)
class UpdateRule:
    """An update rule: theta <- theta + alpha * scale * sum_i weights_i z_i.

    `weights` returns the weights (n,); `scale` returns a number or (D,), given n and sigma (D,).
    """

    weights: Callable[[NESHyperparameters, MemberScores], Scores]
    scale: Callable[[int, NDArray[np.float32]], NDArray[np.float32] | float]
    needs_pairs: bool = False  # requires mirrored sampling
    transforms: bool = False  # uses `score_transform`

    def step(
        self,
        hp: NESHyperparameters,
        sigma: NDArray[np.float32],
        z: NDArray[np.float32],
        scores: MemberScores,
    ) -> NDArray[np.float32]:
        """The step (D,) that is added to theta."""
        direction = self.weights(hp, scores) @ z
        step: NDArray[np.float32] = (hp.step_size * self.scale(len(z), sigma) * direction).astype(
            np.float32
        )
        return step


def _both(scores: MemberScores) -> Scores:
    assert scores.minus is not None
    return finite(np.concatenate([scores.plus, scores.minus]))


def _difference(values: Scores) -> Scores:
    plus, minus = np.split(values, 2)
    difference: Scores = plus - minus
    return difference


def _utilities(hp: NESHyperparameters, scores: MemberScores) -> Scores:
    return _difference(utilities(_both(scores)))


def _centred_ranks(hp: NESHyperparameters, scores: MemberScores) -> Scores:
    return _difference(centred_rank(_both(scores)))


def _better_sign(hp: NESHyperparameters, scores: MemberScores) -> Scores:
    average = float(finite(scores.centre).mean())
    if scores.minus is None:
        return transform(hp.score_transform, scores.plus, average, hp.ties)
    plus, minus = np.split(_both(scores), 2)
    sign = np.where(minus > plus, -1.0, 1.0)
    weights = transform(hp.score_transform, np.maximum(plus, minus), average, hp.ties)
    signed: Scores = sign * weights
    return signed


RULES = {
    "snes": UpdateRule(_utilities, lambda n, sigma: sigma, needs_pairs=True),
    "antithetic": UpdateRule(_centred_ranks, lambda n, sigma: 1 / n, needs_pairs=True),
    "paper": UpdateRule(_better_sign, lambda n, sigma: 1 / n, transforms=True),
    "authors": UpdateRule(_better_sign, lambda n, sigma: sigma, transforms=True),
}
