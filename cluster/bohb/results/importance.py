"""Importance of hyperparameters: how much worse a model predicts results without one.

The model is a random forest (Breiman, 2001) of the ranks of the results at the budget that has most
of them; ranks, because results without an SE say little by how large they are. It predicts results
that it was not fitted to, a fifth at a time. The importance of a hyperparameter is the drop of R^2
when its values are permuted among all of these. It tells what mattered within the search space and
among the configurations that were tried; where R^2 is not positive, it tells nothing.
"""

from collections import Counter
from dataclasses import dataclass

import ConfigSpace as CS
import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from cluster.bohb.study.journal import Journal

Floats = NDArray[np.float64]

#: Fewest results at one budget for importances, per hyperparameter and besides.
_PER_HYPERPARAMETER, _BESIDES = 2, 4
_FOLDS, _TREES, _PERMUTATIONS = 5, 100, 10


@dataclass(frozen=True)
class Importance:
    """Importances of d hyperparameters, in the order of `names`."""

    names: tuple[str, ...]
    mean: Floats  # (d,) drop of R^2
    std: Floats  # (d,) over permutations
    budget: int
    results: int
    explained: float  # R^2 on results that the forest was not fitted to


def importance(space: CS.ConfigurationSpace, journal: Journal) -> Importance | None:
    """The importances in a study; None while it has too few results."""
    good = journal.successes
    if not good:
        return None
    budget = max(Counter(line.budget for line in good).items(), key=lambda item: (item[1], item[0]))
    proposals = journal.proposals
    at_budget = [line for line in good if line.budget == budget[0]]
    if len(at_budget) < _PER_HYPERPARAMETER * len(space) + _BESIDES:
        return None
    inputs = np.array([unit_values(space, proposals[line.id].configuration) for line in at_budget])
    ranks = rankdata([line.objective for line in at_budget])
    if np.ptp(ranks) == 0:
        return None
    explained, drops = _held_out(inputs, ranks)
    return Importance(
        tuple(space),
        drops.mean(axis=1),
        drops.std(axis=1),
        budget[0],
        len(at_budget),
        explained,
    )


def _held_out(inputs: Floats, ranks: Floats) -> tuple[float, Floats]:
    """R^2 of forests on the ranks (n,) that they were not fitted to, and its drops (d, p) when one
    of the inputs (n, d) is permuted."""
    # Imports pandas and more, which takes a second: only where there is a forest to fit.
    from sklearn.ensemble import RandomForestRegressor
    from sklearn.model_selection import KFold

    folds = []
    for seen, unseen in KFold(_FOLDS, shuffle=True, random_state=0).split(inputs):
        forest = RandomForestRegressor(_TREES, random_state=0, n_jobs=1)
        folds.append((forest.fit(inputs[seen], ranks[seen]), unseen))

    def explained(given: Floats) -> Floats:
        """R^2 (p,) on inputs (p, n, d)."""
        predicted = np.empty(given.shape[:2])
        for forest, unseen in folds:
            rows = given[:, unseen]
            flat = forest.predict(rows.reshape(-1, inputs.shape[1]))
            predicted[:, unseen] = flat.reshape(rows.shape[:2])
        found: Floats = 1 - np.square(predicted - ranks).mean(axis=1) / ranks.var()
        return found

    (best,), random = explained(inputs[None]), np.random.default_rng(0)
    drops = np.empty((inputs.shape[1], _PERMUTATIONS))
    for column, values in enumerate(inputs.T):
        permuted = np.repeat(inputs[None], _PERMUTATIONS, axis=0)
        permuted[:, :, column] = [random.permutation(values) for _ in range(_PERMUTATIONS)]
        drops[column] = best - explained(permuted)
    return float(best), drops


def unit_values(space: CS.ConfigurationSpace, configuration: dict[str, object]) -> Floats:
    """The values (d,) of a configuration, each on [0, 1] over its range, as the search sees them;
    categories evenly spread; NaN for one that the configuration does not have, or out of range."""
    found = []
    for name, dimension in space.items():
        value = configuration.get(name)
        if value is None or not dimension.legal_value(value):
            found.append(np.nan)
            continue
        place = float(dimension.to_vector(value))
        if isinstance(dimension, CS.CategoricalHyperparameter):
            place /= max(len(dimension.choices) - 1, 1)
        found.append(place)
    return np.array(found)
