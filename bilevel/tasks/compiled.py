"""Simulators of the tasks with compiled dynamics (`bilevel.kernels.dynamics`)."""

from collections.abc import Callable
from dataclasses import dataclass, replace

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
class Simulator:
    """The parts of a compiled task's simulator that run once an episode, and its labels."""

    initial_physics: Callable[[np.random.Generator, int], Physics]  # n initial states (n, p)
    physics: Callable[[NDArray[np.float32]], Physics]  # state (p,) at an observation (S,)
    labels: Labels


def _acrobot_physics(observation: NDArray[np.float32]) -> Physics:
    cos1, sin1, cos2, sin2, *velocities = observation.astype(np.float64)
    return np.array([np.arctan2(sin1, cos1), np.arctan2(sin2, cos2), *velocities])


def _pendulum_physics(observation: NDArray[np.float32]) -> Physics:
    cosine, sine, velocity = observation.astype(np.float64)
    return np.array([np.arctan2(sine, cosine), velocity])


def _unchanged(observation: NDArray[np.float32]) -> Physics:
    return observation.astype(np.float64)


def _resting_car(rng: np.random.Generator, n: int) -> Physics:
    return np.stack([rng.uniform(-0.6, -0.4, n), np.zeros(n)], axis=1)


_CARTPOLE_LABELS = Labels(
    ("cart position (m)", "cart velocity (m/s)", "pole angle (rad)", "pole velocity (rad/s)"),
    ("push left", "push right"),
    axes=(2, 3),
)

_ACROBOT_LABELS = Labels(
    (
        *("cosine of angle 1", "sine of angle 1", "cosine of angle 2", "sine of angle 2"),
        *("velocity of link 1 (rad/s)", "velocity of link 2 (rad/s)"),
    ),
    ("torque -1", "torque 0", "torque +1"),
    axes=(4, 5),
)

_CAR_LABELS = Labels(("position", "velocity"), ("push left", "no push", "push right"), axes=(0, 1))

_PENDULUM_LABELS = Labels(
    ("cosine of the angle", "sine of the angle", "velocity (rad/s)"), ("torque",), axes=(1, 2)
)

#: Simulators by the code of their dynamics.
SIMULATORS = {
    dynamics.CARTPOLE: Simulator(
        lambda rng, n: rng.uniform(-0.05, 0.05, (n, 4)),
        _unchanged,
        _CARTPOLE_LABELS,
    ),
    dynamics.ACROBOT: Simulator(
        lambda rng, n: rng.uniform(-0.1, 0.1, (n, 4)).astype(np.float32).astype(np.float64),
        _acrobot_physics,
        _ACROBOT_LABELS,
    ),
    dynamics.MOUNTAIN_CAR: Simulator(_resting_car, _unchanged, _CAR_LABELS),
    dynamics.CONTINUOUS_MOUNTAIN_CAR: Simulator(
        _resting_car, _unchanged, replace(_CAR_LABELS, actions=("force",))
    ),
    dynamics.PENDULUM: Simulator(
        lambda rng, n: rng.uniform(-1, 1, (n, 2)) * (np.pi, 1.0),
        _pendulum_physics,
        _PENDULUM_LABELS,
    ),
}
