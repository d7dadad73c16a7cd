"""Importance of hyperparameters: the loss of a model's accuracy without each of them.

The model is a random forest (Breiman, 2001) of the ranks of the results at the budget with the most
results. Ranks are used because objectives of configurations without an SE have little meaning as
numbers. The forest predicts held-out results, a fifth at a time. The importance of a hyperparameter
is the drop of R^2 on all held-out results when its values are permuted. It applies to the search
space and the configurations that were tried, and is meaningless unless R^2 is positive.
"""

from collections import Counter
from dataclasses import dataclass

import ConfigSpace as CS
import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from cluster.bohb.study.journal import Journal

Floats = NDArray[np.float64]

#: Results at a budget that are needed: per hyperparameter, and in addition.
_PER_HYPERPARAMETER, _ADDITIONAL = 2, 4
_FOLDS, _TREES, _PERMUTATIONS = 5, 100, 10


@dataclass(frozen=True)
class Importance:
    """Importances of d hyperparameters, in the order of `names`."""

    names: tuple[str, ...]
    mean: Floats  # (d,) drop of R^2
    std: Floats  # (d,) over permutations
    budget: int
    results: int
    explained: float  # R^2 on held-out results


def importance(space: CS.ConfigurationSpace, journal: Journal) -> Importance | None:
    """Return the importances in a study; None if it has too few results, or equal ones."""
    counts = Counter(line.budget for line in journal.successes)
    budget = max(counts, key=lambda budget: (counts[budget], budget), default=0)
    lines = [line for line in journal.successes if line.budget == budget]
    if len(lines) < _PER_HYPERPARAMETER * len(space) + _ADDITIONAL:
        return None
    ranks = rankdata([line.objective for line in lines])
    if np.ptp(ranks) == 0:
        return None
    proposals = journal.proposals
    inputs = np.array([unit_values(space, proposals[line.id].configuration) for line in lines])
    explained, drops = _held_out(inputs, ranks)
    mean, std = drops.mean(axis=1), drops.std(axis=1)
    return Importance(tuple(space), mean, std, budget, len(lines), explained)


def _held_out(inputs: Floats, ranks: Floats) -> tuple[float, Floats]:
    """Fit forests to inputs (n, d) and ranks (n,); return R^2 on held-out ranks, and its drops
    (d, p) with p permutations of each input."""
    # Imported here because they take a second, for pandas among others.
    from sklearn.ensemble import RandomForestRegressor
    from sklearn.model_selection import KFold

    folds = []
    for seen, unseen in KFold(_FOLDS, shuffle=True, random_state=0).split(inputs):
        forest = RandomForestRegressor(_TREES, random_state=0, n_jobs=1)
        folds.append((forest.fit(inputs[seen], ranks[seen]), unseen))

    def explained(stack: Floats) -> Floats:
        """R^2 (p,) on inputs (p, n, d)."""
        predicted = np.empty(stack.shape[:2])
        for forest, unseen in folds:
            rows = stack[:, unseen]
            flat = forest.predict(rows.reshape(-1, inputs.shape[1]))
            predicted[:, unseen] = flat.reshape(rows.shape[:2])
        r2: Floats = 1 - np.square(predicted - ranks).mean(axis=1) / ranks.var()
        return r2

    (best,), rng = explained(inputs[None]), np.random.default_rng(0)
    drops = np.empty((inputs.shape[1], _PERMUTATIONS))
    for column, values in enumerate(inputs.T):
        permuted = np.repeat(inputs[None], _PERMUTATIONS, axis=0)
        permuted[:, :, column] = [rng.permutation(values) for _ in range(_PERMUTATIONS)]
        drops[column] = best - explained(permuted)
    return float(best), drops


def unit_values(space: CS.ConfigurationSpace, configuration: dict[str, object]) -> Floats:
    """Return the values (d,) of a configuration, scaled to [0, 1] over their ranges as in the
    search, with evenly spaced categories; NaN where a value is missing or out of range."""
    values = np.full(len(space), np.nan)
    for index, (name, dimension) in enumerate(space.items()):
        value = configuration.get(name)
        if value is not None and dimension.legal_value(value):
            values[index] = dimension.to_vector(value)
            if isinstance(dimension, CS.CategoricalHyperparameter):
                values[index] /= max(len(dimension.choices) - 1, 1)
    return values
