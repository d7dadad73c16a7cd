"""Frozen, validated hyperparameters, and recipes as data files."""

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
    CONFIRMING_AGENTS,
    SCORE_TRANSFORMS,
    UPDATES,
    VARIATIONS,
    Hyperparameters,
    NESHyperparameters,
    SEHyperparameters,
    StoredHyperparameters,
)
from bilevel.hyperparameters.recipes import RECIPES, default_agents, load_recipe, recipe_text

__all__ = [
    "ACTIVATIONS",
    "CONFIRMING_AGENTS",
    "RECIPES",
    "SCORE_TRANSFORMS",
    "UPDATES",
    "VARIATIONS",
    "AgentHyperparameters",
    "DDQNHyperparameters",
    "DuelingDDQNHyperparameters",
    "Hyperparameters",
    "NESHyperparameters",
    "SEHyperparameters",
    "StoredHyperparameters",
    "TD3Hyperparameters",
    "agent_hyperparameters",
    "agent_names",
    "default_agents",
    "load_recipe",
    "recipe_text",
]
