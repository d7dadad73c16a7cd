"""CartPole-v0 with the values of the paper (Table "Fixed hyperparameters")."""

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels import dynamics
from bilevel.tasks.compiled import CompiledTask, Labels, Physics


def _initial_physics(rng: np.random.Generator, n: int) -> Physics:
    return rng.uniform(-0.05, 0.05, (n, 4))


def _physics(observation: NDArray[np.float32]) -> Physics:
    return observation.astype(np.float64)


CARTPOLE = CompiledTask(
    "CartPole-v0",
    state_size=4,
    n_actions=2,
    step_limit=200,
    solved_reward=195.0,
    worst_score=0.0,
    dynamics=dynamics.CARTPOLE,
    initial_physics=_initial_physics,
    physics=_physics,
    labels=Labels(
        ("cart position (m)", "cart velocity (m/s)", "pole angle (rad)", "pole velocity (rad/s)"),
        ("push left", "push right"),
        axes=(2, 3),
    ),
)
