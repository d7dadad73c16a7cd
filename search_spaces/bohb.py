"""The spaces `full`, from the paper's table "Optimized hyperparameters", and `core`, for short
searches.

`search_spaces.translation` documents the names of dimensions.
"""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import ConfigSpace as CS

from bilevel.errors import unknown_value
from bilevel.hyperparameters import ACTIVATIONS, SCORE_TRANSFORMS, agent_hyperparameters
from search_spaces import SPACES
from search_spaces.translation import INVERSE

Dimension = CS.hyperparameters.Hyperparameter[Any, Any]


def _full() -> list[Dimension]:
    """Return the paper's dimensions of NES and SE, with its ranges and scales."""
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
    """Return the paper's dimensions of agents. The paper has none for TD3: its ranges go from about
    a third to three times the defaults."""
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
    """Return seven dimensions of NES and SE, with wide ranges around the recipe `default`.

    With seven dimensions BOHB's model needs 2 * (7 + 1) results at a budget. Agents have no
    dimensions: recipes vary their hyperparameters in every generation, because an SE must train
    all of them.
    """
    return [
        CS.Float("nes.step_size", (0.2, 4.0), log=True),
        CS.Float("nes.std_dev", (0.03, 1.0), log=True),
        CS.Integer("nes.population_size", (3, 48), log=True),
        CS.Float("nes.1-averaging", (0.02, 0.9), log=True),
        CS.Integer("nes.start_candidates", (16, 512), log=True),
        CS.Integer("se.hidden_size", (4, 64), log=True),
        CS.Float("se.spread", (0.5, 2.0), log=True),
    ]


def search_space(
    name: str, agents: Sequence[str] = ("ddqn",), seed: int | None = None
) -> CS.ConfigurationSpace:
    """Build `core`, or `full` with the dimensions that each of the `agents` has.

    For DDQN, `full` has the 18 dimensions of the paper's table. Raises InvalidInput for an unknown
    name.
    """
    if name not in SPACES:
        raise unknown_value("search space", name, SPACES)
    space = _full() if name == "full" else _core()
    for agent in agents if name == "full" else ():
        known = {field.name for field in fields(agent_hyperparameters(agent))}
        space += [
            d for d in _full_agent(agent) if d.name.split(".")[1].removeprefix(INVERSE) in known
        ]
    return CS.ConfigurationSpace(name=name, seed=seed, space=space)
