"""Tasks with compiled dynamics (`bilevel.kernels.dynamics`), with the values of the paper (Table
"Fixed hyperparameters")."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels import dynamics

Physics = NDArray[np.float64]


@dataclass(frozen=True)
class Labels:
    """Names of a task's observations and actions, in plots."""

    observations: tuple[str, ...]
    actions: tuple[str, ...]
    axes: tuple[int, int]  # indices of the two observations that plots show


@dataclass(frozen=True)
class CompiledTask:
    """Fixed values of a compiled task, and the parts of its simulator that run once an episode."""

    id: str
    state_size: int
    n_actions: int
    step_limit: int
    solved_reward: float
    worst_score: float
    dynamics: int  # code of the compiled step in `bilevel.kernels.dynamics`
    initial_physics: Callable[[np.random.Generator, int], Physics]  # n initial states (n, p)
    physics: Callable[[NDArray[np.float32]], Physics]  # state (p,) at an observation (S,)
    labels: Labels


def _acrobot_initial_physics(rng: np.random.Generator, n: int) -> Physics:
    return rng.uniform(-0.1, 0.1, (n, 4)).astype(np.float32).astype(np.float64)


def _acrobot_physics(observation: NDArray[np.float32]) -> Physics:
    cos1, sin1, cos2, sin2, *velocities = observation.astype(np.float64)
    return np.array([np.arctan2(sin1, cos1), np.arctan2(sin2, cos2), *velocities])


_CARTPOLE = CompiledTask(
    "CartPole-v0",
    state_size=4,
    n_actions=2,
    step_limit=200,
    solved_reward=195.0,
    worst_score=0.0,
    dynamics=dynamics.CARTPOLE,
    initial_physics=lambda rng, n: rng.uniform(-0.05, 0.05, (n, 4)),
    physics=lambda observation: observation.astype(np.float64),
    labels=Labels(
        ("cart position (m)", "cart velocity (m/s)", "pole angle (rad)", "pole velocity (rad/s)"),
        ("push left", "push right"),
        axes=(2, 3),
    ),
)

_ACROBOT = CompiledTask(
    "Acrobot-v1",
    state_size=6,
    n_actions=3,
    step_limit=500,
    solved_reward=-100.0,
    worst_score=-500.0,
    dynamics=dynamics.ACROBOT,
    initial_physics=_acrobot_initial_physics,
    physics=_acrobot_physics,
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

#: All compiled tasks by the code of their dynamics.
COMPILED = {task.dynamics: task for task in (_CARTPOLE, _ACROBOT)}
