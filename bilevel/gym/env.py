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
from bilevel.tasks import RealEnv

_MODES = ["human", "rgb_array"]


class SyntheticEnv(gymnasium.Env[Any, Any]):
    """A learned synthetic environment (SE). Agents that train on it are tested on the real task.

    - Actions and observations: the spaces of the real task, so that an agent can move between both.
      A state that is outside of the observation space is observed as the nearest element of it.
    - Rewards: the output of the reward network. Returns do not compare to the real task's returns.
    - Initial states: drawn from the real task's reset distribution, or the SE's own.
    - Terminated: the output of the done network, `info["done"]`, exceeds 0.5.
    - Truncated: the episode reaches the SE's step limit.

    `path` is an address as in `bilevel.load`::

        env = gymnasium.make("bilevel/Synthetic-CartPole-v0")  # an SE of the zoo
        env = gymnasium.make("bilevel/SyntheticEnv-v0", path="best_se.safetensors")
        env = gymnasium.make("bilevel/SyntheticEnv-v0", path="models:/SE-CartPole-v0@best")

    The `render_mode` "human" or "rgb_array" uses the renderer of a classic control task. Raises
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
        self.step_limit = self.se.architecture.step_limit
        self.kernel = self.se.se.kernel
        self._work = work_space(self.kernel)
        self._state: NDArray[np.float32] | None = None
        self._steps = 0
        self.render_mode = render_mode
        # The real task gives spaces, renders states and, unless it is compiled, initial states.
        env = task.make(render_mode)
        self._real = RealEnv(env, task.id)
        if render_mode is not None:
            env.reset(seed=0)  # some renderers need it
            self.metadata = {**self.metadata, "render_fps": env.metadata["render_fps"]}
        self.observations, self.actions = self._real.observations, self._real.actions
        self.observation_space = env.observation_space
        self.action_space = env.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode and return its initial observation and info."""
        super().reset(seed=seed)
        self._state = self.initial_state(self.np_random)
        self._steps = 0
        if self.render_mode == "human":
            self.render()
        return self.observations.unflatten(self._state), {}

    def initial_state(self, rng: np.random.Generator) -> NDArray[np.float32]:
        """Draw an initial state (S,)."""
        if self.se.architecture.own_initial_states:
            return self.se.se.initial_states(rng, 1).reshape(-1)
        return self._task.observe(self._task.initial_physics(rng, 1, self._real)[0])

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take one step and return observation, reward, terminated, truncated and info.

        Raises InvalidInput for an invalid action, and ResetNeeded before the first reset.
        """
        if self._state is None:
            raise ResetNeeded("call reset before step")
        inward = self.actions.inward(action)
        next_state = np.empty_like(self._state)
        reward, done = step(self.kernel, self._state, inward, next_state, self._work)
        self._state = next_state
        self._steps += 1
        if self.render_mode == "human":
            self.render()
        terminated = bool(done > DONE)
        truncated = not terminated and self._steps >= self.step_limit
        observation, info = self.observations.unflatten(next_state), {"done": float(done)}
        return observation, float(reward), terminated, truncated, info

    def render(self) -> Any:
        """Draw the current state: return an image (height, width, 3) in the mode `rgb_array`, or
        update the window in the mode `human`. Raises ResetNeeded before the first reset."""
        if self._state is None:
            raise ResetNeeded("call reset before render")
        if self.render_mode is None:
            return None
        real: Any = self._real.env.unwrapped
        real.state = self._task.physics(self._state)
        return real.render()

    def close(self) -> None:
        """Close the real task's environment and its window."""
        self._real.close()
