"""A prior of a search: configurations around a given one."""

from collections.abc import Mapping
from typing import Any

import ConfigSpace as CS
import numpy as np
from ConfigSpace.util import deactivate_inactive_hyperparameters

from bilevel.errors import InvalidInput, first_line

#: Standard deviation of a draw, in units of a dimension's range (of its logarithm, if it has one).
SPREAD = 0.15
#: Chance of a category to be drawn anew, from all of its choices.
OTHER = 0.3


def nearest(space: CS.ConfigurationSpace, values: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration that is nearest to `values`: numbers beyond a range are moved to its end,
    categories that are not in the space become its default. Raises InvalidInput if the space
    forbids it."""
    found: dict[str, Any] = {}
    for name, dimension in space.items():
        value = values[name]
        if isinstance(dimension, CS.CategoricalHyperparameter):
            found[name] = value if value in dimension.choices else dimension.default_value
        elif isinstance(dimension, CS.Constant):
            found[name] = dimension.value
        else:
            low, high = dimension.to_value(0.0), dimension.to_value(1.0)
            found[name] = type(value)(min(max(value, low), high))
    return active(space, found)


def around(
    space: CS.ConfigurationSpace, values: Mapping[str, Any], rng: np.random.Generator
) -> dict[str, Any]:
    """Draw a configuration around a configuration: normal in each number, over the scale of its
    dimension, and cut off at the ends of its range; now and then another category. Raises
    InvalidInput for a draw that the space forbids."""
    found: dict[str, Any] = {}
    for name, dimension in space.items():
        value = values.get(name, dimension.default_value)  # a condition may leave it out
        if isinstance(dimension, CS.CategoricalHyperparameter):
            choices = dimension.choices
            found[name] = (
                choices[int(rng.integers(len(choices)))] if rng.random() < OTHER else value
            )
        elif isinstance(dimension, CS.Constant):
            found[name] = value
        else:
            place = float(dimension.to_vector(value)) + SPREAD * rng.standard_normal()
            found[name] = dimension.to_value(np.clip(place, 0.0, 1.0))
    return active(space, found)


def active(space: CS.ConfigurationSpace, values: dict[str, Any]) -> dict[str, Any]:
    """The values whose conditions in the space are met. Raises InvalidInput for a combination that
    the space forbids."""
    try:
        return dict(deactivate_inactive_hyperparameters(values, space))
    except ValueError as error:
        raise InvalidInput(f"the search space forbids {values}: {first_line(error)}") from None
