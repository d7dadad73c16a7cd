"""Frozen, validated hyperparameters, and the paper's tables as presets."""

from bilevel.hyperparameters.definitions import (
    ACTIVATIONS,
    SCORE_TRANSFORMS,
    UPDATES,
    DDQNHyperparameters,
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
    "DDQNHyperparameters",
    "Hyperparameters",
    "NESHyperparameters",
    "SEHyperparameters",
    "best_preset",
    "load_preset",
]
