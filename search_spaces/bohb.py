"""BOHB's search spaces: the paper's Table 1, and a smaller space for short searches.

A dimension is named after the hyperparameter that it sets, `section.field`, where the section is
`nes`, `se` or an agent's name. A dimension that the paper marks "True (inv.)" is named
`section.1-field`: one minus the value is sampled on the log scale.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import ConfigSpace as CS

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters import (
    ACTIVATIONS,
    SCORE_TRANSFORMS,
    Hyperparameters,
    agent_hyperparameters,
)

Dimension = CS.hyperparameters.Hyperparameter[Any, Any]

_INVERSE = "1-"


def _full() -> list[Dimension]:
    """Dimensions of NES and SE in Table 1, with its ranges and scales."""
    return [
        CS.Float("nes.step_size", (0.1, 1.0), log=True),
        CS.Float("nes.std_dev", (0.01, 1.0), log=True),
        CS.Categorical("nes.mirrored_sampling", (False, True)),
        CS.Categorical("nes.score_transform", SCORE_TRANSFORMS),
        CS.Integer("se.hidden_layers", (1, 2)),
        CS.Integer("se.hidden_size", (48, 192), log=True),
        CS.Categorical("se.activation", ACTIVATIONS),
    ]


def _full_agent(agent: str) -> list[Dimension]:
    """Dimensions of the agent in Table 1, and of TD3's hyperparameters, which the table lacks: from
    about a third to three times their defaults."""
    return [
        CS.Integer(f"{agent}.init_episodes", (1, 20), log=True),
        CS.Integer(f"{agent}.batch_size", (64, 256)),
        CS.Float(f"{agent}.learning_rate", (0.0001, 0.005), log=True),
        CS.Float(f"{agent}.target_update_rate", (0.005, 0.05), log=True),
        CS.Float(f"{agent}.1-discount", (0.001, 0.1), log=True),
        CS.Float(f"{agent}.initial_epsilon", (0.8, 1.0), log=True),
        CS.Float(f"{agent}.minimal_epsilon", (0.005, 0.05), log=True),
        CS.Float(f"{agent}.1-epsilon_decay", (0.01, 0.2), log=True),
        CS.Integer(f"{agent}.hidden_layers", (1, 2)),
        CS.Integer(f"{agent}.hidden_size", (48, 192), log=True),
        CS.Categorical(f"{agent}.activation", ACTIVATIONS),
        CS.Integer(f"{agent}.policy_delay", (1, 4)),
        CS.Float(f"{agent}.action_noise", (0.03, 0.3), log=True),
        CS.Float(f"{agent}.target_noise", (0.07, 0.7), log=True),
        CS.Float(f"{agent}.initial_temperature", (0.3, 3.0), log=True),
    ]


def _core() -> list[Dimension]:
    """Eight dimensions of NES and SE, so that BOHB's model needs 2 * (8 + 1) results at one budget.
    Ranges are wide around the values of the recipes `default`.

    The agents have none: the recipe draws their learning rates, batches and networks anew for every
    generation, since an SE must teach them all, and confirmations draw theirs as users will.
    """
    return [
        CS.Float("nes.step_size", (0.2, 4.0), log=True),
        CS.Float("nes.std_dev", (0.03, 1.0), log=True),
        CS.Integer("nes.population_size", (3, 48), log=True),
        CS.Float("nes.1-averaging", (0.02, 0.9), log=True),
        CS.Integer("nes.start_candidates", (16, 512), log=True),
        CS.Integer("se.hidden_size", (12, 64), log=True),
        CS.Integer("se.step_limit", (20, 200), log=True),
        CS.Float("se.spread", (1.04, 1.3)),
    ]


#: Spaces by name, each with the recipe that its ranges of step sizes are meant for.
SPACES = {"full": "paper", "core": "default"}


def search_space(
    name: str, agents: Sequence[str] = ("ddqn",), seed: int | None = None
) -> CS.ConfigurationSpace:
    """The space `core` for NES and SE, or `full`, in which each of `agents` has the dimensions of
    its own fields too. For DDQN, `full` has the 18 dimensions of Table 1.

    Raises InvalidInput for another name.
    """
    if name not in SPACES:
        raise one_of("search space", name, SPACES)
    space = _full() if name == "full" else _core()
    for agent in agents if name == "full" else ():
        known = {spec.name for spec in fields(agent_hyperparameters(agent))}
        space += [d for d in _full_agent(agent) if _field(d.name) in known]
    return CS.ConfigurationSpace(name=name, seed=seed, space=space)


def _field(dimension: str) -> str:
    return dimension.partition(".")[2].removeprefix(_INVERSE)


def to_hyperparameters(base: Hyperparameters, configuration: Mapping[str, Any]) -> Hyperparameters:
    """`base` with the values of a configuration.

    Values may be numpy scalars, as ConfigSpace and Ray Tune return them.
    Raises InvalidInput for a name or a value that is not allowed.
    """
    changes: dict[str, dict[str, Any]] = {}
    sections: dict[str, Any] = {
        "nes": base.nes,
        "se": base.se,
        **{hp.agent: hp for hp in base.agents},
    }
    for name, value in configuration.items():
        section, _, field = name.partition(".")
        plain = value.item() if hasattr(value, "item") else value
        if field.startswith(_INVERSE):
            if not isinstance(plain, float):
                raise InvalidInput(f"hyperparameter {name!r} must be a float; got {plain!r}")
            field, plain = field.removeprefix(_INVERSE), 1.0 - plain
        if isinstance(plain, str):
            plain = str(plain)  # np.str_ is a subclass of str
        known = (
            [f"{section}.{s.name}" for s in fields(sections[section])]
            if section in sections
            else []
        )
        if f"{section}.{field}" not in known:
            allowed = known or [f"{other}.*" for other in sections]
            raise one_of("hyperparameter", name, allowed)
        changes.setdefault(section, {})[field] = plain
    return replace(
        base,
        nes=replace(base.nes, **changes.get("nes", {})),
        se=replace(base.se, **changes.get("se", {})),
        agents=tuple(replace(hp, **changes.get(hp.agent, {})) for hp in base.agents),
    )


def of_hyperparameters(hp: Hyperparameters, names: Iterable[str]) -> dict[str, Any]:
    """The values that `hp` has in the dimensions with these names, the inverse of
    `to_hyperparameters`. Raises InvalidInput for a name that `hp` does not have."""
    sections: dict[str, Any] = {
        "nes": hp.nes,
        "se": hp.se,
        **{agent.agent: agent for agent in hp.agents},
    }
    values = {}
    for name in names:
        section, _, field = name.partition(".")
        plain = field.removeprefix(_INVERSE)
        if section not in sections or not hasattr(sections[section], plain):
            raise InvalidInput(f"the recipe {hp.recipe!r} has no hyperparameter {name!r}")
        value = getattr(sections[section], plain)
        values[name] = 1.0 - value if field.startswith(_INVERSE) else value
    return values
