"""An SE as a gymnasium environment."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.kernels.synthetic_env import DONE, step, work_space
from bilevel.synthetic_env.source import load
from bilevel.tasks import checked_action

_MODES = ["human", "rgb_array"]


class SyntheticEnv(gymnasium.Env[NDArray[np.float32], np.int64]):
    """A learned synthetic environment (SE). Agents that train on it are tested on the real task.

    - Actions: `Discrete(A)`, the actions of the real task.
    - Observations: `Box(-inf, inf, (S,), float32)`, as in the real task, without its bounds.
    - Rewards: the output of the reward network. Returns do not compare to the real task's returns.
    - Initial states: drawn from the real task's reset distribution.
    - Terminated: the output of the done network, `info["done"]`, exceeds 0.5.
    - Truncated: the episode reaches the SE's step limit.

    `path` is an address as in `bilevel.load`::

        env = gymnasium.make("bilevel/Synthetic-CartPole-v0")  # an SE of the zoo
        env = gymnasium.make("bilevel/SyntheticEnv-v0", path="best_se.safetensors")
        env = gymnasium.make("bilevel/SyntheticEnv-v0", path="models:/SE-CartPole-v0@best")

    The `render_mode` "human" or "rgb_array" uses the renderer of CartPole-v0 or Acrobot-v1. Raises
    InvalidInput if there is no SE at `path`, or if its task is unknown or cannot be rendered.
    """

    metadata: dict[str, Any] = {"render_modes": _MODES, "render_fps": 30}  # noqa: RUF012

    def __init__(self, path: str | Path | None = None, render_mode: str | None = None) -> None:
        if path is None:
            raise InvalidInput("path is missing: a file, a name of the zoo or an MLflow address")
        self.se = load(path)
        self._task = task = self.se.task()
        if render_mode is not None and not (task.compiled and render_mode in _MODES):
            raise InvalidInput(f"render mode {render_mode!r} is not available for {task.id}")
        self.n_actions = self.se.architecture.n_actions
        self.step_limit = self.se.architecture.step_limit
        self.kernel = self.se.se.kernel
        self._work = work_space(self.kernel)
        self._state: NDArray[np.float32] | None = None
        self._steps = 0
        self.render_mode = render_mode
        # The real task, which renders states or, unless it is compiled, gives initial states.
        self._real: Any = None
        if render_mode is not None or not task.compiled:
            self._real = task.make(render_mode)
        if render_mode is not None:
            self.metadata = {**self.metadata, "render_fps": self._real.metadata["render_fps"]}
        self.first_action = 0 if self._real is None else int(self._real.action_space.start)
        shape = (self.se.architecture.state_size,)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = gymnasium.spaces.Discrete(self.n_actions, start=self.first_action)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode and return its initial observation (S,) and info."""
        super().reset(seed=seed)
        self._state = self.initial_state(self.np_random)
        self._steps = 0
        if self.render_mode == "human":
            self.render()
        return self._state.copy(), {}

    def initial_state(self, rng: np.random.Generator) -> NDArray[np.float32]:
        """Draw an initial state (S,) of the real task."""
        return self._task.observe(self._task.initial_physics(rng, 1, self._real)[0])

    def step(
        self, action: np.int64
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Take one step and return observation (S,), reward, terminated, truncated and info.

        Raises InvalidInput for an invalid action, and ResetNeeded before the first reset.
        """
        if self._state is None:
            raise ResetNeeded("call reset before step")
        index = checked_action(action, self.n_actions, self.first_action)
        next_state = np.empty_like(self._state)
        reward, done = step(self.kernel, self._state, index, next_state, self._work)
        self._state = next_state
        self._steps += 1
        if self.render_mode == "human":
            self.render()
        truncated = self._steps >= self.step_limit
        return next_state.copy(), float(reward), bool(done > DONE), truncated, {"done": float(done)}

    def render(self) -> Any:
        """Draw the current state: return an image (height, width, 3) in the mode `rgb_array`, or
        update the window in the mode `human`. Raises ResetNeeded before the first reset."""
        if self._state is None:
            raise ResetNeeded("call reset before render")
        if self.render_mode is None:
            return None
        real = self._real.unwrapped
        real.state = self._task.physics(self._state)
        return real.render()

    def close(self) -> None:
        """Close the real task's environment and its window."""
        if self._real is not None:
            self._real.close()
