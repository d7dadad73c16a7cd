"""Images of an SE's states, drawn by the renderer of the real task.

Gymnasium's classic control tasks draw their attribute `state`, the state of their simulator. It is
set to the simulator's state at an observation (`Task.physics`).
"""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from bilevel.errors import InvalidInput, first_line, unknown_value
from bilevel.tasks import Task

#: Gymnasium's render modes that are available.
MODES = ("human", "rgb_array")


def draws_its_state(task: Task, env: Any) -> bool:
    """Reset a task's environment and return whether its attribute `state` is the simulator's state
    at the observation."""
    expected = task.physics(env.reset(seed=0)[0])
    try:
        state = np.asarray(getattr(env.unwrapped, "state", None), np.float64)
    except (TypeError, ValueError):
        return False
    return state.shape == expected.shape and np.allclose(state, expected, atol=1e-5)


class Renderer:
    """Draws states of an SE as states of its task.

    Raises InvalidInput for an unknown mode, and for a task that cannot draw a given state.
    """

    def __init__(self, task: Task, mode: str) -> None:
        if mode not in MODES:
            raise unknown_value("render mode", mode, MODES)
        unavailable = f"render mode {mode!r} is not available: {task.id} cannot draw a given state"
        self._task = task
        try:
            self._env: Any = task.make(render_mode=mode).unwrapped
        except (TypeError, gymnasium.error.Error) as error:
            raise InvalidInput(f"{unavailable} ({first_line(error)})") from None
        self.fps = int(self._env.metadata.get("render_fps", 30))
        if not draws_its_state(task, self._env):
            self.close()
            raise InvalidInput(unavailable)

    def draw(self, observation: NDArray[np.float32]) -> Any:
        """Draw an observation (S,): return an image (height, width, 3) in the mode `rgb_array`, or
        update the window in the mode `human`."""
        self._env.state = self._task.physics(observation)
        return self._env.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._env.close()
