"""Importance of hyperparameters: the loss of a model's accuracy without each of them.

The model is a random forest (Breiman, 2001) of the ranks of the results at the budget with the most
results. Ranks are used because objectives of configurations without an SE have little meaning as
numbers. The forest predicts held-out results, a fifth at a time. The importance of a hyperparameter
is the drop of R^2 on all held-out results when its values are permuted. It applies to the search
space and the configurations that were tried.
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
_FOLDS, _TREES, _PERMUTATIONS = 5, 50, 5


@dataclass(frozen=True)
class Importance:
    """Importances of d hyperparameters, in the order of the space."""

    mean: Floats  # (d,) drop of R^2
    std: Floats  # (d,) over permutations
    budget: int
    results: int
    explained: float  # R^2 on held-out results, positive


def importance(space: CS.ConfigurationSpace, journal: Journal) -> Importance | None:
    """Return the importances in a study; None if it has too few results to predict others."""
    counts = Counter(line.budget for line in journal.successes)
    budget = max(counts, key=lambda budget: (counts[budget], budget), default=0)
    lines = [line for line in journal.successes if line.budget == budget]
    ranks = rankdata([line.objective for line in lines])
    if len(lines) < _PER_HYPERPARAMETER * len(space) + _ADDITIONAL or np.ptp(ranks) == 0:
        return None
    proposals = journal.proposals
    inputs = np.array([unit_values(space, proposals[line.id].configuration) for line in lines])

    # Imported here because they take a second, for pandas among others.
    from sklearn.ensemble import RandomForestRegressor
    from sklearn.inspection import permutation_importance
    from sklearn.metrics import r2_score
    from sklearn.model_selection import KFold

    folds = []
    for seen, unseen in KFold(_FOLDS, shuffle=True, random_state=0).split(inputs):
        forest = RandomForestRegressor(_TREES, random_state=0, n_jobs=1)
        folds.append((forest.fit(inputs[seen], ranks[seen]), unseen))

    def explained(_: object, values: Floats, ranks: Floats) -> float:
        predicted = np.empty_like(ranks)
        for forest, unseen in folds:
            predicted[unseen] = forest.predict(values[unseen])
        return float(r2_score(ranks, predicted))

    score = explained(None, inputs, ranks)
    if score <= 0:
        return None
    found = permutation_importance(
        forest, inputs, ranks, scoring=explained, n_repeats=_PERMUTATIONS, random_state=0
    )
    return Importance(found.importances_mean, found.importances_std, budget, len(lines), score)


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
