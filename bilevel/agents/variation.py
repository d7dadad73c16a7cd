"""Hyperparameter variation of the inner loop's agents (paper, Table "Ranges used for sampling
random agent HP config.").

NES draws fresh agents, so that the SE does not overfit to one agent. Because large agents are
expensive, `small` draws only small ones, and `narrowed` draws from the full ranges and replaces a
large agent by a narrow one that learns at the same pace.
"""

import math
from bisect import bisect_right
from dataclasses import fields, replace
from typing import Any

import numpy as np

from bilevel.errors import unknown_value
from bilevel.hyperparameters import VARIATIONS, AgentHyperparameters
from bilevel.hyperparameters.validation import within_range

#: The default learning rates (paper, Table "Default HPs"). A third to three times the default is
#: drawn; other agents, as TD3 in the authors' code, have their own default.
_LEARNING_RATE = {"ddqn": 1e-3, "dueling-ddqn": 1e-3}

#: Fields that are drawn, if an agent has them.
VARIED = ("learning_rate", "batch_size", "hidden_size", "hidden_layers")

#: Ranges of hidden units and batch size (drawn on the log scale), and of hidden layers.
SIZES, LAYERS = (42, 384), (1, 3)

#: Largest `step_cost` of a small agent: 2.8 times the paper's tuned agent for CartPole.
SMALL = 250_000.0

#: Maximum draws of the sizes of a small agent. The number of hidden layers is drawn once, so that
#: deep agents, few of which are small, are as frequent as others: without them, an SE teaches only
#: shallow agents.
_DRAWS = 128

#: Minimum number of hidden units of a narrowed agent.
NARROWEST = 16


def draw_agent(
    agents: tuple[AgentHyperparameters, ...], vary: str, seed: int
) -> AgentHyperparameters:
    """Draw one of the agents and vary its fields in VARIED, within the agent's own ranges, by one
    of VARIATIONS; `small` returns the cheapest draw if no draw is small."""
    if vary not in VARIATIONS:
        raise unknown_value("variation of agents", vary, VARIATIONS)
    rng = np.random.default_rng(seed)
    agent = agents[int(rng.integers(len(agents)))] if len(agents) > 1 else agents[0]
    if vary == "no":
        return agent
    layers = int(rng.integers(LAYERS[0], LAYERS[1] + 1))
    drawn = [_varied(agent, layers, rng)]
    while vary == "small" and drawn[-1].step_cost > SMALL and len(drawn) < _DRAWS:
        drawn.append(_varied(agent, layers, rng))
    if vary == "small":
        return min(drawn, key=lambda hp: max(hp.step_cost, SMALL))
    return narrowed(drawn[-1]) if vary == "narrowed" else drawn[-1]


def narrowed(agent: AgentHyperparameters) -> AgentHyperparameters:
    """Reduce hidden units until the agent is small, then the batch if NARROWEST units are still too
    many; increase its learning rate by the square root of the ratio of the widths.

    With Adam, the change of a network's outputs grows with its width (Yang and Hu, 2021, "Tensor
    Programs IV"). The square root was chosen in trials (docs/research-log.md): with it,
    narrow agents fail on an SE about as often as the wide agents that they replace.
    """
    narrow = _reduced(_reduced(agent, "hidden_size", NARROWEST), "batch_size", SIZES[0])
    before, after = (getattr(hp, "hidden_size", 1) for hp in (agent, narrow))
    if before == after or not hasattr(agent, "learning_rate"):
        return narrow
    return _changed(narrow, learning_rate=agent.learning_rate * math.sqrt(before / after))


def _reduced(agent: AgentHyperparameters, name: str, minimum: int) -> AgentHyperparameters:
    """The agent with the largest value of a field, but at least `minimum`, with which it is small;
    unchanged if `step_cost` ignores the field."""
    if not hasattr(agent, name) or agent.step_cost <= SMALL:
        return agent
    values = range(int(within_range(type(agent), name, minimum)), getattr(agent, name))

    def cost(value: int) -> float:
        return _changed(agent, **{name: value}).step_cost

    if not values or cost(values[0]) >= agent.step_cost:
        return agent
    return _changed(agent, **{name: values[max(bisect_right(values, SMALL, key=cost) - 1, 0)]})


def _varied(
    agent: AgentHyperparameters, layers: int, rng: np.random.Generator
) -> AgentHyperparameters:
    learning_rate = _LEARNING_RATE.get(agent.agent, getattr(agent, "learning_rate", 1.0))
    low, high = SIZES
    return _changed(
        agent,
        learning_rate=float(learning_rate * 3 ** rng.uniform(-1, 1)),
        batch_size=round(low * (high / low) ** rng.uniform()),
        hidden_size=round(low * (high / low) ** rng.uniform()),
        hidden_layers=layers,
    )


def _changed(agent: AgentHyperparameters, **values: Any) -> AgentHyperparameters:
    """The agent with other values of the fields that it has, each within its range."""
    known = values.keys() & {spec.name for spec in fields(agent)}
    allowed: dict[str, Any] = {
        name: within_range(type(agent), name, values[name]) for name in known
    }
    return replace(agent, **allowed)
