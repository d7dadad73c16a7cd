"""Hyperparameter variation of the inner loop's agents (paper, Table "Ranges used for sampling
random agent HP config.").

NES draws fresh agents from these ranges, so that the SE does not overfit to one agent. Two
variations avoid the cost of large agents: `small` draws small ones only, and `narrowed` draws from
the full ranges and replaces a large agent by a narrow one that learns at the same pace.
"""

import math
from bisect import bisect_right
from dataclasses import fields, replace
from typing import Any

import numpy as np

from bilevel.errors import one_of
from bilevel.hyperparameters import VARIATIONS, AgentHyperparameters
from bilevel.hyperparameters.validation import within_range

#: The default learning rates (paper, Table "Default HPs"): a third to three times of
#: it is drawn. The table of ranges gives that of DDQN and Dueling DDQN; TD3's is the
#: same around its own default, as in the authors' code.
_LEARNING_RATE = {"ddqn": 1e-3, "dueling-ddqn": 1e-3, "td3": 5e-4}

#: Fields that are drawn, of agents that have them.
VARIED = ("learning_rate", "batch_size", "hidden_size", "hidden_layers")

#: Hidden units and batch size, drawn on the log scale; hidden layers.
SIZES, LAYERS = (42, 384), (1, 3)

#: Multiplications of a minibatch's pass (`AgentHyperparameters.step_cost`) up to which an
#: agent is small: 2.8 times those of the paper's tuned agent for CartPole.
SMALL = 250_000.0

#: Draws of the sizes among which a small agent is looked for. The number of hidden layers is drawn
#: once, so that deep agents, few of which are small, are as frequent as others: an SE that no deep
#: agent took part in learning teaches shallow ones alone.
_DRAWS = 128

#: Hidden units that a narrowed agent keeps at least.
NARROWEST = 16


def draw_agent(
    agents: tuple[AgentHyperparameters, ...], vary: str, seed: int
) -> AgentHyperparameters:
    """One of the agents, learning rate, batch size, hidden size and hidden layers (those of them
    that it has) drawn anew as one of VARIATIONS says, within the agent's own ranges; by `seed`
    alone. `small` takes the cheapest draw if none is small.

    Raises InvalidInput for another variation.
    """
    if vary not in VARIATIONS:
        raise one_of("variation of agents", vary, VARIATIONS)
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
    """The agent with as many hidden units as a small agent may have, and then with a smaller batch
    if NARROWEST is still too wide; its learning rate is higher by the square root of the ratio of
    the widths.

    With Adam at a given learning rate, the outputs of a network change by an amount that grows with
    its width (Yang and Hu, 2021, "Tensor Programs IV"). The higher rate lets the narrow network
    learn at the pace of the wide one, so that an SE on which wide agents fail is found out cheaply.
    The square root was chosen in trials (docs/nes.md): with it, narrow agents fail on an SE about
    as often as those they replace; with the ratio itself they fail more often, and at the old rate
    never badly.
    """
    narrow = _cut(_cut(agent, "hidden_size", NARROWEST), "batch_size", SIZES[0])
    before, after = (getattr(hp, "hidden_size", 1) for hp in (agent, narrow))
    if before == after or not hasattr(agent, "learning_rate"):
        return narrow
    return _changed(narrow, learning_rate=agent.learning_rate * math.sqrt(before / after))


def _changed(agent: AgentHyperparameters, **values: Any) -> AgentHyperparameters:
    """The agent with other values of those of these fields that it has, each within its range."""
    known = values.keys() & {spec.name for spec in fields(agent)}
    fitting: dict[str, Any] = {
        name: within_range(type(agent), name, values[name]) for name in known
    }
    return replace(agent, **fitting)


def _cut(agent: AgentHyperparameters, name: str, least: int) -> AgentHyperparameters:
    """The agent with the largest value of that field, `least` or more, with which it is small; as
    it is, if its cost does not tell of that field."""
    if not hasattr(agent, name):
        return agent
    value, least = getattr(agent, name), int(within_range(type(agent), name, least))
    if agent.step_cost <= SMALL or value <= least:
        return agent

    def with_size(size: int) -> AgentHyperparameters:
        return _changed(agent, **{name: size})

    if with_size(least).step_cost >= agent.step_cost:
        return agent
    sizes = range(least, value)
    small = bisect_right(sizes, SMALL, key=lambda size: with_size(size).step_cost)
    return with_size(sizes[max(small - 1, 0)])


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
