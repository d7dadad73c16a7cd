"""What BOHB searches: the paper's Table 1, and a smaller space for short searches.

A dimension is named after the hyperparameter it sets, `section.field`; one that the
paper marks "True (inv.)" is named `section.1-field`: one minus the value is sampled
on the log scale.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import ConfigSpace as CS

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters import ACTIVATIONS, SCORE_TRANSFORMS, Hyperparameters

Dimension = CS.hyperparameters.Hyperparameter[Any, Any]

_INVERSE = "1-"


def _full() -> list[Dimension]:
    """The 18 hyperparameters of Table 1, with its ranges and scales."""
    return [
        CS.Float("nes.step_size", (0.1, 1.0), log=True),
        CS.Float("nes.std_dev", (0.01, 1.0), log=True),
        CS.Categorical("nes.mirrored_sampling", (False, True)),
        CS.Categorical("nes.score_transform", SCORE_TRANSFORMS),
        CS.Integer("se.hidden_layers", (1, 2)),
        CS.Integer("se.hidden_size", (48, 192), log=True),
        CS.Categorical("se.activation", ACTIVATIONS),
        CS.Integer("agent.init_episodes", (1, 20), log=True),
        CS.Integer("agent.batch_size", (64, 256)),
        CS.Float("agent.learning_rate", (0.0001, 0.005), log=True),
        CS.Float("agent.target_update_rate", (0.005, 0.05), log=True),
        CS.Float("agent.1-discount", (0.001, 0.1), log=True),
        CS.Float("agent.initial_epsilon", (0.8, 1.0), log=True),
        CS.Float("agent.minimal_epsilon", (0.005, 0.05), log=True),
        CS.Float("agent.1-epsilon_decay", (0.01, 0.2), log=True),
        CS.Integer("agent.hidden_layers", (1, 2)),
        CS.Integer("agent.hidden_size", (48, 192), log=True),
        CS.Categorical("agent.activation", ACTIVATIONS),
    ]


def _core() -> list[Dimension]:
    """Six that a search of an hour can tell apart: the model needs 2 * (6 + 1)
    results at one budget. NES ranges are those of the antithetic update."""
    return [
        CS.Float("nes.step_size", (0.02, 0.2), log=True),
        CS.Float("nes.std_dev", (0.005, 0.1), log=True),
        CS.Integer("se.hidden_size", (48, 192), log=True),
        CS.Integer("agent.init_episodes", (1, 20), log=True),
        CS.Float("agent.learning_rate", (0.0001, 0.005), log=True),
        CS.Integer("agent.hidden_size", (48, 192), log=True),
    ]


#: Spaces by name, and the NES update that their step sizes are meant for.
SPACES = {"full": "paper", "core": "antithetic"}


def search_space(name: str, seed: int | None = None) -> CS.ConfigurationSpace:
    """The space `full` or `core`. Raises InvalidInput for another name."""
    if name not in SPACES:
        raise one_of("search space", name, SPACES)
    return CS.ConfigurationSpace(name=name, seed=seed, space=_full() if name == "full" else _core())


def to_hyperparameters(base: Hyperparameters, configuration: Mapping[str, Any]) -> Hyperparameters:
    """`base` with the values of a configuration in place.

    Values may be numpy scalars, as ConfigSpace and Ray Tune hand them out.
    Raises InvalidInput for a name or a value that is not allowed.
    """
    changes: dict[str, dict[str, Any]] = {}
    for name, value in configuration.items():
        section, _, field = name.partition(".")
        plain = value.item() if hasattr(value, "item") else value
        if field.startswith(_INVERSE):
            field, plain = field.removeprefix(_INVERSE), 1.0 - plain
        if isinstance(plain, str):
            plain = str(plain)  # np.str_ is a str of another type
        target = getattr(base, section, None)
        if not is_dataclass(target) or field not in {spec.name for spec in fields(target)}:
            raise InvalidInput(f"unknown hyperparameter {name!r}")
        changes.setdefault(section, {})[field] = plain
    return replace(
        base,
        **{section: replace(getattr(base, section), **new) for section, new in changes.items()},
    )
