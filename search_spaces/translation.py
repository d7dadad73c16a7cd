"""Hyperparameters from a configuration's values, and back.

A dimension is named after the hyperparameter that it sets, `section.field`, where the section is
`nes`, `se` or an agent's name. A dimension that the paper marks "True (inv.)" is named
`section.1-field`: one minus the value is sampled on the log scale.
"""

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters import Hyperparameters, agent_names

#: What precedes the field in the name of an inverted dimension.
INVERSE = "1-"


def native(value: Any) -> Any:
    """A value as Python's own, where it is a numpy scalar."""
    return value.item() if hasattr(value, "item") else value


def to_hyperparameters(base: Hyperparameters, configuration: Mapping[str, Any]) -> Hyperparameters:
    """`base` with the values of a configuration, as `changed` takes them. Raises InvalidInput."""
    sections = changed(base.sections, configuration)
    return replace(
        base,
        nes=sections["nes"],
        se=sections["se"],
        agents=tuple(sections[hp.agent] for hp in base.agents),
    )


def changed(sections: Mapping[str, Any], configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Hyperparameters by the names of their sections, with the values of a configuration.

    Values may be numpy scalars, as ConfigSpace and Ray Tune return them. Raises InvalidInput for a
    name or a value that is not allowed.
    """
    changes: dict[str, dict[str, Any]] = {section: {} for section in sections}
    for name, value in configuration.items():
        section, _, field = name.partition(".")
        plain = native(value)
        if field.startswith(INVERSE):
            if not isinstance(plain, float):
                raise InvalidInput(f"hyperparameter {name!r} must be a float; got {plain!r}")
            field, plain = field.removeprefix(INVERSE), 1.0 - plain
        known = (
            [f"{section}.{s.name}" for s in fields(sections[section])]
            if section in sections
            else []
        )
        if f"{section}.{field}" not in known:
            if section in agent_names() and section not in sections:
                agents = ", ".join(one for one in sections if one not in ("nes", "se"))
                raise InvalidInput(
                    f"{name} is of an agent that takes no part; these do: {agents} (--agent)"
                )
            allowed = known or [f"{other}.*" for other in sections]
            raise one_of("hyperparameter", name, allowed)
        if field in changes[section]:
            raise InvalidInput(f"hyperparameter {section}.{field} is set twice")
        changes[section][field] = plain
    return {section: replace(hp, **changes[section]) for section, hp in sections.items()}


def of_hyperparameters(hp: Hyperparameters, names: Iterable[str]) -> dict[str, Any]:
    """The values that `hp` has in the dimensions with these names, the inverse of
    `to_hyperparameters`. Raises InvalidInput for a name that `hp` does not have."""
    sections = hp.sections
    values = {}
    for name in names:
        section, _, field = name.partition(".")
        plain = field.removeprefix(INVERSE)
        if section not in sections or not hasattr(sections[section], plain):
            raise InvalidInput(f"the recipe {hp.recipe!r} has no hyperparameter {name!r}")
        value = getattr(sections[section], plain)
        values[name] = 1.0 - value if field.startswith(INVERSE) else value
    return values
