"""UpdateSE (paper, Algorithm 1): the next psi from the members' scores, by name.

symbol   shape     meaning
------   -------   ----------------------------------------------------------
psi      (P,)      parameters of the unperturbed SE
eps      (n, P)    perturbations, ~ N(0, sigma^2 I)
F        (n,)      fitness of psi + eps (`plus`) and psi - eps (`minus`)
n_p      -         population size n

update        psi + ...
-----------   -------------------------------------------------------------------
paired        alpha * mean_i r_i eps_i / sigma, r the signed ranks of the differences
              F_i+ - F_i- (Wilcoxon, 1945); the two SEs of a pair are tried on the same
              agent with the same random numbers, so that they differ in the SE alone
antithetic    alpha * mean_i (u_i+ - u_i-) eps_i / sigma, u the centred ranks of all
              2n scores: the textbook estimator (Salimans et al., 2017)
paper         alpha / (n_p sigma) * sum_i w_i eps_i
authors       alpha * sum_i w_i eps_i: the authors' code, which does not divide

In the last two, w are the transformed scores, and mirrored sampling is the authors':
of each pair the better sign is kept, with its score, and the other is dropped.
All steps are proportional to eps; where a `scale` (`adapted_scale`) multiplies sigma, the
step is multiplied by the one that follows from the scores it is made of.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from bilevel.hyperparameters import NESHyperparameters
from bilevel.nes.transforms import centred_rank, finite, transform


@dataclass(frozen=True)
class MemberScores:
    """Fitness of one generation: scores, less what train steps cost."""

    centre: NDArray[np.float64]  # (n,) agents trained on psi itself
    plus: NDArray[np.float64]  # (n,)
    minus: NDArray[np.float64] | None  # (n,), None without mirrored sampling


def update_step(
    hp: NESHyperparameters, eps: NDArray[np.float32], scores: MemberScores
) -> NDArray[np.float32]:
    """What is added to psi, (P,)."""
    if hp.update in _PAIRWISE:
        weights = _PAIRWISE[hp.update](scores)
        scale = hp.step_size / (len(eps) * hp.std_dev)
    else:
        weights = _better_sign(hp, scores)
        scale = hp.step_size / (len(eps) * hp.std_dev if hp.update == "paper" else 1.0)
    step: NDArray[np.float32] = (scale * (weights @ eps)).astype(np.float32)
    return step


#: The scale's factor a generation is exp(GAIN * (kept - retention)), and its limits.
GAIN = 1.5
SCALES = 1 / 32, 4.0


def adapted_scale(hp: NESHyperparameters, scale: float, kept: float) -> float:
    """The scale of this generation's alpha and of the next one's sigma, from the scale of
    this one's sigma.

    `kept` is the share of psi's score, above the task's worst, that the SEs psi +- eps have
    on average. Where psi is good, most directions lead away from it: perturbations that
    lose nearly everything are too long to tell them apart, and a step of that length
    destroys psi; perturbations that lose nothing could be longer. In between, `kept` is
    `hp.retention`; 0 leaves the scale alone.
    """
    if not hp.retention:
        return scale
    lowest, highest = SCALES
    return min(max(scale * math.exp(GAIN * (kept - hp.retention)), lowest), highest)


def _paired(scores: MemberScores) -> NDArray[np.float64]:
    """Signed ranks, scaled to the size that differences of centred ranks have when nothing
    but chance orders the scores: sqrt(1/6) in the quadratic mean."""
    assert scores.minus is not None
    plus, minus = np.split(finite(np.concatenate([scores.plus, scores.minus])), 2)
    difference = plus - minus
    ranks = rankdata(np.abs(difference)) / difference.size
    signed: NDArray[np.float64] = np.sqrt(1 / 2) * np.sign(difference) * ranks
    return signed


def _antithetic(scores: MemberScores) -> NDArray[np.float64]:
    assert scores.minus is not None
    utilities = centred_rank(np.concatenate([scores.plus, scores.minus]))
    plus, minus = np.split(utilities, 2)
    difference: NDArray[np.float64] = plus - minus
    return difference


_PAIRWISE = {"paired": _paired, "antithetic": _antithetic}


def _better_sign(hp: NESHyperparameters, scores: MemberScores) -> NDArray[np.float64]:
    average = float(finite(scores.centre).mean())
    if scores.minus is None:
        return transform(hp.score_transform, scores.plus, average)
    both = finite(np.concatenate([scores.plus, scores.minus]))
    plus, minus = np.split(both, 2)
    sign = np.where(minus > plus, -1.0, 1.0)
    return sign * transform(hp.score_transform, np.maximum(plus, minus), average)
