"""Acrobot-v1 with the values of the paper (Table "Fixed hyperparameters")."""

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels import dynamics
from bilevel.tasks.compiled import CompiledTask, Labels, Physics


def _initial_physics(rng: np.random.Generator, n: int) -> Physics:
    return rng.uniform(-0.1, 0.1, (n, 4)).astype(np.float32).astype(np.float64)


def _physics(observation: NDArray[np.float32]) -> Physics:
    cos1, sin1, cos2, sin2, *velocities = observation.astype(np.float64)
    return np.array([np.arctan2(sin1, cos1), np.arctan2(sin2, cos2), *velocities])


ACROBOT = CompiledTask(
    "Acrobot-v1",
    state_size=6,
    n_actions=3,
    step_limit=500,
    solved_reward=-100.0,
    worst_score=-500.0,
    dynamics=dynamics.ACROBOT,
    initial_physics=_initial_physics,
    physics=_physics,
    labels=Labels(
        (
            "cosine of angle 1",
            "sine of angle 1",
            "cosine of angle 2",
            "sine of angle 2",
            "velocity of link 1 (rad/s)",
            "velocity of link 2 (rad/s)",
        ),
        ("torque -1", "torque 0", "torque +1"),
        axes=(4, 5),
    ),
)
