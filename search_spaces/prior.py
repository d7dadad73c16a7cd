"""Configurations at and around a given one, the prior of a search."""

from collections.abc import Mapping
from typing import Any

import ConfigSpace as CS
import numpy as np
from ConfigSpace.util import deactivate_inactive_hyperparameters

from bilevel.errors import InvalidInput, first_line

#: Standard deviation of a draw, relative to a dimension's range (of its logarithm if it has one).
SPREAD = 0.15
#: Probability of drawing a category uniformly instead of keeping it.
UNIFORM_CATEGORY = 0.3


def nearest(space: CS.ConfigurationSpace, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration nearest to `values`: numbers are clipped to their ranges, unknown
    categories become the default. Raises InvalidInput if the space forbids it."""
    configuration: dict[str, Any] = {}
    for name, dimension in space.items():
        value = values[name]
        if isinstance(dimension, CS.CategoricalHyperparameter):
            configuration[name] = value if value in dimension.choices else dimension.default_value
        elif isinstance(dimension, CS.Constant):
            configuration[name] = dimension.value
        else:
            low, high = dimension.to_value(0.0), dimension.to_value(1.0)
            configuration[name] = type(value)(min(max(value, low), high))
    return _active(space, configuration)


def around(
    space: CS.ConfigurationSpace, values: Mapping[str, Any], rng: np.random.Generator
) -> dict[str, Any]:
    """Draw a configuration around `values`: numbers from a normal distribution clipped to the
    range, categories uniformly with probability UNIFORM_CATEGORY. Raises InvalidInput if the space
    forbids the draw."""
    configuration: dict[str, Any] = {}
    for name, dimension in space.items():
        value = values.get(name, dimension.default_value)  # inactive dimensions have no value
        if isinstance(dimension, CS.CategoricalHyperparameter):
            choices = dimension.choices
            if rng.random() < UNIFORM_CATEGORY:
                value = choices[int(rng.integers(len(choices)))]
            configuration[name] = value
        elif isinstance(dimension, CS.Constant):
            configuration[name] = value
        else:
            position = float(dimension.to_vector(value)) + SPREAD * rng.standard_normal()
            configuration[name] = dimension.to_value(np.clip(position, 0.0, 1.0))
    return _active(space, configuration)


def _active(space: CS.ConfigurationSpace, values: dict[str, Any]) -> dict[str, Any]:
    try:
        return dict(deactivate_inactive_hyperparameters(values, space))
    except ValueError as error:
        raise InvalidInput(f"the search space forbids {values}: {first_line(error)}") from None
