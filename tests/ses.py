"""Random SEs for tests."""

from typing import Any

import numpy as np

from bilevel.evolution import SearchDistribution
from bilevel.hyperparameters import Hyperparameters
from bilevel.synthetic_env import SE, Architecture, SEDistribution, StoredSE, family_of
from bilevel.tasks import Task


def make_se(task: Task, layers: int = 1, activation: Any = "lrelu", seed: int = 0) -> StoredSE:
    """A plain SE with 12 units per layer and the task's step limit."""
    sizes = task.state_size, task.action_size, layers, 12
    architecture = Architecture(*sizes, activation, task.step_limit, task.continuous)
    psi = architecture.initialize(np.random.default_rng(seed))
    info = {"score_mean": 12.5}
    return StoredSE(SE(architecture, psi), task.id, task.step_limit, task.solved_reward, info)


def around(task: Task, hp: Hyperparameters, seed: int = 0) -> SEDistribution:
    """A search distribution around a random SE."""
    family = family_of(task, hp.se, task.unit_scale)
    mean = family.initialize(np.random.default_rng(seed))
    return SEDistribution(family, SearchDistribution(mean, mean, sigma=0.05))
