"""Frozen, validated hyperparameters."""

from bilevel.hyperparameters.agents import (
    ACTIVATIONS,
    AgentHyperparameters,
    DDQNHyperparameters,
    DuelingDDQNHyperparameters,
    PPOHyperparameters,
    TD3Hyperparameters,
    agent_hyperparameters,
    agent_names,
    default_agents,
)
from bilevel.hyperparameters.definitions import (
    CONFIRMING_AGENTS,
    SCORE_TRANSFORMS,
    UPDATES,
    VARIATIONS,
    Hyperparameters,
    NESHyperparameters,
    SEHyperparameters,
    StoredHyperparameters,
    Variation,
)

__all__ = [
    "ACTIVATIONS",
    "CONFIRMING_AGENTS",
    "SCORE_TRANSFORMS",
    "UPDATES",
    "VARIATIONS",
    "AgentHyperparameters",
    "DDQNHyperparameters",
    "DuelingDDQNHyperparameters",
    "Hyperparameters",
    "NESHyperparameters",
    "PPOHyperparameters",
    "SEHyperparameters",
    "StoredHyperparameters",
    "TD3Hyperparameters",
    "Variation",
    "agent_hyperparameters",
    "agent_names",
    "default_agents",
]
