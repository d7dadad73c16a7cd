"""Definition of a task with compiled dynamics (`bilevel.kernels.dynamics`).

To add a task, define its `CompiledTask` in a file like `cartpole.py`, and add it to
`bilevel.tasks.task.COMPILED`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Physics = NDArray[np.float64]


@dataclass(frozen=True)
class Labels:
    """Names of a task's observations and actions, in plots."""

    observations: tuple[str, ...]
    actions: tuple[str, ...]
    axes: tuple[int, int] = (0, 1)  # indices of the two observations that plots show


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
