"""Importance of hyperparameters: how much worse a model of the objective predicts without one.

The model is a random forest (Breiman, 2001), fitted to the logarithms of the results at the budget
that has most of them. The importance of a hyperparameter is the drop of R^2 when its values are
permuted. It tells what mattered within the search space and among the configurations that were
tried; a forest that predicts little itself tells little.
"""

from collections import Counter
from dataclasses import dataclass

import ConfigSpace as CS
import numpy as np
from numpy.typing import NDArray

from cluster.bohb.journal import Journal

#: Fewest results at one budget that a forest is fitted to, per hyperparameter and besides.
_PER_HYPERPARAMETER, _BESIDES = 2, 4
_TREES, _PERMUTATIONS = 100, 10


@dataclass(frozen=True)
class Importance:
    """Importances of d hyperparameters, in the order of `names`."""

    names: tuple[str, ...]
    mean: NDArray[np.float64]  # (d,) drop of R^2
    std: NDArray[np.float64]  # (d,) over permutations
    budget: int
    results: int
    out_of_bag: float  # R^2 on the results that a tree has not seen


def importance(space: CS.ConfigurationSpace, journal: Journal) -> Importance | None:
    """The importances in a study; None while it has too few results."""
    good = [line for line in journal.results if line.loss is not None]
    if not good:
        return None
    budget = max(Counter(line.budget for line in good).items(), key=lambda item: (item[1], item[0]))
    values = {line.id: line.configuration for line in journal.configs}
    at_budget = [line for line in good if line.budget == budget[0]]
    if len(at_budget) < _PER_HYPERPARAMETER * len(space) + _BESIDES:
        return None
    inputs = np.array([unit_values(space, values[line.id]) for line in at_budget])
    objectives = np.log([line.objective for line in at_budget])
    if np.ptp(objectives) == 0:
        return None
    # Imports pandas and more, which takes a second: only where there is a forest to fit.
    from sklearn.ensemble import RandomForestRegressor
    from sklearn.inspection import permutation_importance

    forest = RandomForestRegressor(_TREES, oob_score=True, random_state=0, n_jobs=1)
    forest.fit(inputs, objectives)
    found = permutation_importance(
        forest, inputs, objectives, n_repeats=_PERMUTATIONS, random_state=0
    )
    return Importance(
        tuple(space),
        found.importances_mean,
        found.importances_std,
        budget[0],
        len(at_budget),
        float(forest.oob_score_),
    )


def unit_values(
    space: CS.ConfigurationSpace, configuration: dict[str, object]
) -> NDArray[np.float64]:
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
