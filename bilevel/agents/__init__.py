"""Agents: torch definitions, which the compiled kernels must match, and the registry of agents."""

from importlib import import_module
from typing import Any

from bilevel.agents.agent import (
    Agent,
    Build,
    RegisteredAgent,
    Transition,
    get_agent,
    load_plugins,
    register_agent,
    registered_agents,
)
from bilevel.hyperparameters import (
    AgentHyperparameters,
    DDQNHyperparameters,
    DuelingDDQNHyperparameters,
    PPOHyperparameters,
    TD3Hyperparameters,
)
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.kernels import ddqn, ppo, td3, td3_discrete


def _definition(module: str, name: str) -> Build:
    """A builder that imports torch and the class `name` on first use."""

    def build(hp: Any, state_size: int, action_size: int, seed: int) -> Agent:
        definition: Build = getattr(import_module(f"bilevel.agents.{module}"), name)
        return definition(hp, state_size, action_size, seed)

    return build


register_agent(DDQNHyperparameters, _definition("ddqn", "DDQN"), ddqn.new_agent)
register_agent(DuelingDDQNHyperparameters, _definition("ddqn", "DDQN"), ddqn.new_agent)
register_agent(
    TD3Hyperparameters, _definition("td3_discrete", "DiscreteTD3"), td3_discrete.new_agent
)
register_agent(TD3Hyperparameters, _definition("td3", "TD3"), td3.new_agent, continuous=True)
_ppo, _continuous_ppo = _definition("ppo", "PPO"), _definition("ppo", "ContinuousPPO")
register_agent(PPOHyperparameters, _ppo, ppo.new_agent)
register_agent(PPOHyperparameters, _continuous_ppo, ppo.new_continuous_agent, continuous=True)

__all__ = [
    "Agent",
    "AgentHyperparameters",
    "RegisteredAgent",
    "Transition",
    "get_agent",
    "hyperparameters",
    "load_plugins",
    "register_agent",
    "registered_agents",
]
