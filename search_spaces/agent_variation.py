"""The ranges from which agent hyperparameters are drawn when they are varied
(paper, Table "Ranges used for sampling random agent HP config.")."""

from dataclasses import fields, replace
from typing import Any

import ConfigSpace as CS
import numpy as np

from bilevel.hyperparameters import AgentHyperparameters

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


def draw_agent(
    agents: tuple[AgentHyperparameters, ...], vary: bool, seed: int
) -> AgentHyperparameters:
    """One of the agents, with its varied hyperparameters drawn anew if asked for; by
    `seed` alone."""
    agent = agents[0]
    if len(agents) > 1:
        agent = agents[int(np.random.default_rng(seed).integers(len(agents)))]
    if not vary:
        return agent
    drawn = agent_variation_space(agent, seed % 2**32).sample_configuration()
    return replace(
        agent,
        **{
            name: value.item() if hasattr(value, "item") else value
            for name, value in dict(drawn).items()
        },
    )
