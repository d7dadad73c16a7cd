"""An SE as a gymnasium environment, for use in any training code:

    import bilevel, gymnasium
    env = gymnasium.make("bilevel/Synthetic-CartPole-v0")  # one that is shipped (`bilevel.zoo`)
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path="best_se.safetensors")
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path="models:/SE-CartPole-v0@best")

The first observation is drawn from the real task's reset distribution, the others follow the SE.
`info["done"]` is the raw done output: the episode terminates above 0.5. It is truncated at the SE's
own step limit. With `render_mode` the real task's renderer draws the SE's states.
"""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.gym.rendering import MODES, Renderer, draws_its_state


class SyntheticEnv(gymnasium.Env[NDArray[np.float32], np.int64]):
    """The SE of a file, with observations Box (S,) float32 and the real task's actions.

    `path` may also be a name of the zoo or MLflow's address of an SE
    (`bilevel.synthetic_env.source`). Raises InvalidInput if the file is missing or damaged, if
    gymnasium does not know its task, or if the task cannot draw the SE's states in this
    `render_mode` (`bilevel.gym.rendering`).
    """

    metadata: dict[str, Any] = {"render_modes": list(MODES), "render_fps": 30}  # noqa: RUF012

    def __init__(self, path: str | Path | None = None, render_mode: str | None = None) -> None:
        from bilevel.kernels.synthetic_env import work_space
        from bilevel.synthetic_env.source import load

        if path is None:
            raise InvalidInput("path is missing: a file, a name of the zoo or MLflow's address")
        self.se = se = load(path)
        self._task = se.task()
        self.step_limit, self.n_actions = se.architecture.step_limit, se.architecture.n_actions
        self.kernel = se.se.kernel
        self._work = work_space(self.kernel)
        self._state: NDArray[np.float32] | None = None
        self._steps = 0
        shape = (se.architecture.state_size,)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.render_mode = render_mode
        self._renderer = None if render_mode is None else Renderer(self._task, render_mode)
        if self._renderer is not None:
            self.metadata = {**self.metadata, "render_fps": self._renderer.fps}
        # gymnasium draws initial states of a task that is not compiled, in an environment that is
        # made once.
        self._real = None if self._task.compiled else self._task.make()
        if self._real is not None and not draws_its_state(self._task, self._real):
            self.metadata = {**self.metadata, "render_modes": []}
        self.first_action = 0 if self._real is None else int(self._real.action_space.start)  # type: ignore[attr-defined]
        self.action_space = gymnasium.spaces.Discrete(self.n_actions, start=self.first_action)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draw an initial state (S,) from the real task's reset distribution."""
        super().reset(seed=seed)
        self._state = state = self.initial_state(self.np_random)
        self._steps = 0
        self._shown()
        return state.copy(), {}

    def initial_state(self, rng: np.random.Generator) -> NDArray[np.float32]:
        """An initial state (S,) of the real task."""
        return self._task.observe(self._task.initial_physics(rng, 1, self._real)[0])

    def step(
        self, action: np.int64
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Take one step of the SE: next observation (S,), reward, terminated, truncated, info.

        The action may be an integer of any kind, torch's too. Raises InvalidInput for another one,
        and ResetNeeded before the first reset.
        """
        from bilevel.kernels.synthetic_env import DONE, step
        from bilevel.tasks import checked_action

        if self._state is None:
            raise ResetNeeded("call reset before step")
        number = checked_action(action, self.n_actions, self.first_action)
        next_state = np.empty_like(self._state)
        reward, done = step(self.kernel, self._state, number, next_state, self._work)
        self._state = next_state
        self._steps += 1
        self._shown()
        truncated = self._steps >= self.step_limit
        return next_state.copy(), float(reward), bool(done > DONE), truncated, {"done": float(done)}

    def render(self) -> Any:
        """The current state as the real task draws it: an image (height, width, 3), or None in the
        mode `human`, which draws every state by itself. Raises ResetNeeded before the first reset.
        """
        if self._renderer is None:
            gymnasium.logger.warn("render was called without a render_mode: give one to make")
            return None
        if self._state is None:
            raise ResetNeeded("call reset before render")
        return self._renderer.draw(self._state)

    def close(self) -> None:
        """Close the real task's environments, and the window, if there is one."""
        if self._real is not None:
            self._real.close()
        if self._renderer is not None:
            self._renderer.close()

    def _shown(self) -> None:
        if self.render_mode == "human":
            self.render()
