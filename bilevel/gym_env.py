"""An SE as a gymnasium environment, for use in any training code:

    import bilevel, gymnasium
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path="best_se.safetensors")

The first observation is drawn from the real task's reset distribution, the others follow the SE.
`info["done"]` is the raw done output: the episode terminates above 0.5. It is truncated at the SE's
own step limit.
"""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

ENV_ID = "bilevel/SyntheticEnv-v0"


class SyntheticEnv(gymnasium.Env[NDArray[np.float32], np.int64]):
    """The SE of a file, with observations Box (S,) float32 and actions Discrete(A).

    Raises InvalidInput if the file is missing or damaged, or gymnasium does not know its task.
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, path: str | Path) -> None:
        from bilevel.synthetic_env import load_se

        self.se = se = load_se(Path(path))
        self._task = se.task()
        self.step_limit, self.n_actions = se.architecture.step_limit, se.architecture.n_actions
        self.kernel = se.se.kernel
        self._work = np.zeros((2, 3 * se.architecture.hidden_size), np.float32)
        self._state = np.zeros(se.architecture.state_size, np.float32)
        self._steps = 0
        shape = (se.architecture.state_size,)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = gymnasium.spaces.Discrete(se.architecture.n_actions)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draw an initial state (S,) from the real task's reset distribution."""
        super().reset(seed=seed)
        self._state = self.initial_state(self.np_random)
        self._steps = 0
        return self._state.copy(), {}

    def initial_state(self, rng: np.random.Generator) -> NDArray[np.float32]:
        """An initial state (S,) of the real task."""
        return self._task.observe(self._task.initial_physics(rng, 1)[0])

    def step(
        self, action: np.int64
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Take one step of the SE: next observation (S,), reward, terminated, truncated, info.

        The action may be an integer of any kind, torch's too. Raises InvalidInput for another one.
        """
        from bilevel.kernels.synthetic_env import step
        from bilevel.tasks import checked_action

        number = checked_action(action, self.n_actions)
        next_state = np.empty_like(self._state)
        reward, done = step(self.kernel, self._state, number, next_state, self._work)
        self._state = next_state
        self._steps += 1
        truncated = self._steps >= self.step_limit
        return next_state.copy(), float(reward), bool(done > 0.5), truncated, {"done": float(done)}


def register() -> None:
    """Register `ENV_ID` in gymnasium."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            ENV_ID,
            entry_point="bilevel.gym_env:SyntheticEnv",
            vector_entry_point="bilevel.gym_vector_env:SyntheticVectorEnv",
        )
