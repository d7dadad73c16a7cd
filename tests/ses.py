"""Random SEs for tests."""

from typing import Any

import numpy as np

from bilevel.evolution import SearchDistribution
from bilevel.hyperparameters import Hyperparameters, SEHyperparameters
from bilevel.synthetic_env import SE, Architecture, SEDistribution, StoredSE, family_of
from bilevel.tasks import Task


def make_se(task: Task, layers: int = 1, activation: Any = "lrelu", seed: int = 0) -> StoredSE:
    """Return a plain SE with 12 units per layer and the task's step limit."""
    hp = SEHyperparameters(
        family="plain",
        hidden_layers=layers,
        hidden_size=12,
        activation=activation,
        step_limit=0,
        spread=1.0,
    )
    architecture = Architecture.of(task, hp)
    psi = architecture.initialize(np.random.default_rng(seed))
    info = {"score_mean": 12.5}
    return StoredSE(SE(architecture, psi), task.id, task.step_limit, task.solved_reward, info)


def around(task: Task, hp: Hyperparameters, seed: int = 0) -> SEDistribution:
    """Return a search distribution around a random SE."""
    family = family_of(task, hp.se, task.unit_scale)
    mean = family.initialize(np.random.default_rng(seed))
    return SEDistribution(family, SearchDistribution(mean, mean, sigma=0.05))
