"""Translation between configurations and hyperparameters.

A dimension has the name of the hyperparameter that it sets, `section.field`, where the section is
`nes`, `se` or an agent's name. Dimensions that the paper marks "True (inv.)" are named
`section.1-field`: one minus the value is sampled on a log scale.
"""

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

from bilevel.errors import InvalidInput, unknown_value
from bilevel.hyperparameters import Hyperparameters

#: Prefix of the field in the name of an inverted dimension.
INVERSE = "1-"


def native(value: Any) -> Any:
    """Convert a numpy scalar to the Python type."""
    return value.item() if hasattr(value, "item") else value


def to_hyperparameters(base: Hyperparameters, configuration: Mapping[str, Any]) -> Hyperparameters:
    """Return `base` with the values of a configuration. Raises InvalidInput (see `changed`)."""
    sections = changed(base.sections, configuration)
    agents = tuple(sections[hp.agent] for hp in base.agents)
    return replace(base, nes=sections["nes"], se=sections["se"], agents=agents)


def changed(sections: Mapping[str, Any], configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sections of hyperparameters, by name, with the values of a configuration.

    Values may be numpy scalars, as ConfigSpace and Ray Tune return them. Raises InvalidInput for
    unknown names and invalid values.
    """
    changes: dict[str, dict[str, Any]] = {section: {} for section in sections}
    for name, value in configuration.items():
        section, _, field = name.partition(".")
        plain = native(value)
        if field.startswith(INVERSE):
            if not isinstance(plain, float):
                raise InvalidInput(f"hyperparameter {name!r} must be a float; got {plain!r}")
            field, plain = field.removeprefix(INVERSE), 1.0 - plain
        known = [spec.name for spec in fields(sections[section])] if section in sections else []
        if field not in known:
            names = [f"{section}.{one}" for one in known] or [f"{one}.*" for one in sections]
            raise unknown_value("hyperparameter", f"{section}.{field}", names)
        changes[section][field] = plain
    return {section: replace(hp, **changes[section]) for section, hp in sections.items()}


def of_hyperparameters(hp: Hyperparameters, names: Iterable[str]) -> dict[str, Any]:
    """Return the values of `hp` in the named dimensions, the inverse of `to_hyperparameters`.
    Raises InvalidInput for unknown names."""
    values = {}
    for name in names:
        section, _, field = name.partition(".")
        plain = field.removeprefix(INVERSE)
        if not hasattr(hp.sections.get(section), plain):
            raise InvalidInput(f"the recipe {hp.recipe!r} has no hyperparameter {name!r}")
        value = getattr(hp.sections[section], plain)
        values[name] = 1.0 - value if plain != field else value
    return values
