"""Fitness shaping: member scores F (n,) to weights (n,).

The eight score transforms follow the authors' code (`score_transform_type` 0 to 7), in its order.
Non-finite scores count as the lowest. With `ties` "mean", equal scores share their mean rank. With
"order", they rank in the order of the members, as in the authors' code, which ranks by argsort.
"""

from collections.abc import Callable

import numpy as np

from bilevel.evolution.strategy import Scores

#: Scores that exceed the average by at most this value count as average, as in the authors' code,
#: because the mean of equal scores may differ from them in its last bits.
_ROUNDING = 1e-6


def finite(scores: Scores) -> Scores:
    """Replace non-finite scores by the lowest finite score (0 if there is none)."""
    good = np.isfinite(scores)
    lowest = scores[good].min() if good.any() else 0.0
    return np.where(good, scores, lowest)


def linear(scores: Scores, average: float, ties: str) -> Scores:
    """Scores scaled linearly to [0, 1]."""
    span = float(np.ptp(scores))
    return (scores - scores.min()) / span if span > 0 else np.zeros_like(scores)


def rank(scores: Scores, average: float, ties: str) -> Scores:
    """Ranks scaled linearly to [0, 1]."""
    return (_ranks(scores, ties) - 1) / max(scores.size - 1, 1)


def nes(scores: Scores, average: float, ties: str) -> Scores:
    """NES utilities (Wierstra et al., 2008) minus their mean 1/n, scaled to a maximum of 1."""
    weights = utilities(scores, ties)
    highest = float(weights.max())
    return weights / highest if highest > 0 else np.zeros_like(scores)


def nes_unnormalized(scores: Scores, average: float, ties: str) -> Scores:
    """NES utilities without subtracting the mean, scaled to a maximum of 1."""
    weights = _log_rank_utilities(scores, ties)
    return weights / float(weights.max())


def single_best(scores: Scores, average: float, ties: str) -> Scores:
    """1 for the best member, 0 for all others."""
    weights = np.zeros_like(scores)
    weights[scores.argmax()] = 1.0
    return weights


def single_better_average(scores: Scores, average: float, ties: str) -> Scores:
    """1 for the best member if it is better than average, 0 for all others."""
    return single_best(scores, average, ties) * float(_gain(scores, average).max() > 0)


def better_average(scores: Scores, average: float, ties: str) -> Scores:
    """max(F - average, 0), scaled to a maximum of 1 (the paper's choice, "better avg.")."""
    gain = _gain(scores, average)
    return gain / gain.max() if gain.max() > 0 else gain


def better_average_sum(scores: Scores, average: float, ties: str) -> Scores:
    """max(F - average, 0), scaled to a sum of 1."""
    gain = _gain(scores, average)
    return gain / gain.sum() if gain.sum() > 0 else gain


def centred_rank(scores: Scores) -> Scores:
    """Ranks scaled to [-0.5, 0.5], for the update rule `antithetic`."""
    return rank(finite(scores), 0.0, "mean") - 0.5


def utilities(scores: Scores, ties: str = "mean") -> Scores:
    """NES utilities (Wierstra et al., 2008), scaled to a sum of 1, minus their mean 1/n."""
    weights = _log_rank_utilities(scores, ties)
    centred: Scores = weights / weights.sum() - 1 / scores.size
    return centred


def _gain(scores: Scores, average: float) -> Scores:
    """Return max(F - average, 0) (n,)."""
    return np.where(scores > average + _ROUNDING, scores - average, 0.0)


def _ranks(scores: Scores, ties: str) -> Scores:
    """Ranks from 1 (lowest) to n."""
    if ties == "mean":
        _, value, equal = np.unique(scores, return_inverse=True, return_counts=True)
        last = equal.cumsum()  # highest rank within each group of equal scores
        return np.asarray(last - (equal - 1) / 2)[value]
    ranks = np.empty(scores.size)
    ranks[scores.argsort(kind="stable")] = np.arange(1.0, scores.size + 1)
    return ranks


def _log_rank_utilities(scores: Scores, ties: str) -> Scores:
    from_best = _ranks(-scores, ties)
    weights: Scores = np.maximum(0.0, np.log(scores.size / 2 + 1) - np.log(from_best))
    return weights


_TRANSFORMS: dict[str, Callable[[Scores, float, str], Scores]] = {
    "linear": linear,
    "rank": rank,
    "nes": nes,
    "nes-unnormalized": nes_unnormalized,
    "single-best": single_best,
    "single-better-average": single_better_average,
    "better-average": better_average,
    "better-average-sum": better_average_sum,
}

#: Transforms that only compare members: a single member gets no weight, whatever its score.
COMPARING = ("linear", "rank", "nes")


def transform(name: str, scores: Scores, average: float, ties: str = "mean") -> Scores:
    """Weights (n,) of the members by the transform `name`. `average` is the mean score on the
    unperturbed SE, as in the authors' code; the paper averages the population."""
    return _TRANSFORMS[name](finite(scores), average, ties)
