"""The ranges from which agent hyperparameters are drawn when they are varied
(paper, Table "Ranges used for sampling random agent HP config.")."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import ConfigSpace as CS
import numpy as np

from bilevel.errors import one_of
from bilevel.hyperparameters import VARIATIONS, AgentHyperparameters

#: The default learning rates (paper, Table "Default HPs"): a third to three times of
#: it is drawn. The table of ranges gives that of DDQN and Dueling DDQN; TD3's is the
#: same around its own default, as in the authors' code.
_LEARNING_RATE = {"ddqn": 1e-3, "dueling-ddqn": 1e-3, "td3": 5e-4}


def agent_variation_space(
    hp: AgentHyperparameters, seed: int | None = None
) -> CS.ConfigurationSpace:
    """Learning rate, batch size, hidden size (log scale) and hidden layers, those of
    them that the agent has."""
    learning_rate = _LEARNING_RATE.get(hp.agent, getattr(hp, "learning_rate", 1.0))
    space: list[Any] = [
        CS.Float("learning_rate", (learning_rate / 3, learning_rate * 3), log=True),
        CS.Integer("batch_size", (42, 384), log=True),
        CS.Integer("hidden_size", (42, 384), log=True),
        CS.Integer("hidden_layers", (1, 3)),
    ]
    names = {spec.name for spec in fields(hp)}
    space = [dimension for dimension in space if dimension.name in names]
    return CS.ConfigurationSpace(name="agent-variation", seed=seed, space=space)


#: Multiplications of a gradient step (`AgentHyperparameters.step_cost`) up to which an
#: agent is small: four times those of the paper's tuned agent for CartPole.
SMALL = 400_000.0

#: Draws among which a small agent is looked for; nearly every second one is.
_DRAWS = 32


def draw_agent(
    agents: tuple[AgentHyperparameters, ...], vary: str, seed: int
) -> AgentHyperparameters:
    """One of the agents, its hyperparameters drawn anew as one of VARIATIONS says; by
    `seed` alone. Of agents none of which is small, the one that costs least is taken.

    Raises InvalidInput for another variation.
    """
    if vary not in VARIATIONS:
        raise one_of("variation of agents", vary, VARIATIONS)
    agent = agents[0]
    if len(agents) > 1:
        agent = agents[int(np.random.default_rng(seed).integers(len(agents)))]
    if vary == "no":
        return agent
    space = agent_variation_space(agent, seed % 2**32)
    if vary == "all":
        return _varied(agent, space.sample_configuration())
    drawn = [_varied(agent, values) for values in space.sample_configuration(_DRAWS)]
    return next((hp for hp in drawn if hp.step_cost <= SMALL), min(drawn, key=_step_cost))


def _varied(agent: AgentHyperparameters, values: Mapping[str, Any]) -> AgentHyperparameters:
    plain = {name: v.item() if hasattr(v, "item") else v for name, v in dict(values).items()}
    return replace(agent, **plain)


def _step_cost(agent: AgentHyperparameters) -> float:
    return agent.step_cost
