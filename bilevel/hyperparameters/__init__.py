"""Frozen, validated hyperparameters, and the paper's tables as presets."""

from bilevel.hyperparameters.agents import (
    ACTIVATIONS,
    AgentHyperparameters,
    DDQNHyperparameters,
    DuelingDDQNHyperparameters,
    TD3Hyperparameters,
    agent_hyperparameters,
    agent_names,
)
from bilevel.hyperparameters.definitions import (
    SCORE_TRANSFORMS,
    UPDATES,
    VARIATIONS,
    Hyperparameters,
    NESHyperparameters,
    SEHyperparameters,
)
from bilevel.hyperparameters.presets import PRESETS, best_preset, load_preset

__all__ = [
    "ACTIVATIONS",
    "PRESETS",
    "SCORE_TRANSFORMS",
    "UPDATES",
    "VARIATIONS",
    "AgentHyperparameters",
    "DDQNHyperparameters",
    "DuelingDDQNHyperparameters",
    "Hyperparameters",
    "NESHyperparameters",
    "SEHyperparameters",
    "TD3Hyperparameters",
    "agent_hyperparameters",
    "agent_names",
    "best_preset",
    "load_preset",
]
