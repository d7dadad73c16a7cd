"""Gymnasium environments for tests."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec


class CustomEnv(gymnasium.Env[Any, Any]):
    """An environment whose observations, steps and close are given as functions."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(
        self,
        observe: Callable[[np.random.Generator], Any] = lambda rng: np.zeros(2, np.float32),
        step: Callable[[], Any] | None = None,
        close: Callable[[], None] = lambda: None,
        space: gymnasium.Space[Any] = gymnasium.spaces.Box(-20, 20, (2,), np.float32),  # noqa: B008
    ) -> None:
        self.observation_space = space
        self._observe, self._step, self._close = observe, step, close

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        return self._observe(self.np_random), {}

    def step(self, action: Any) -> Any:
        if self._step is not None:
            return self._step()
        return self._observe(self.np_random), -1.0, False, False, {}

    def close(self) -> None:
        self._close()


class ShiftedCartPole(gymnasium.Wrapper[Any, Any, Any, Any]):
    """CartPole-v1 with the actions 5 and 6."""

    def __init__(self, **_: Any) -> None:
        super().__init__(gymnasium.make("CartPole-v1"))
        self.action_space = gymnasium.spaces.Discrete(2, start=5)

    def step(self, action: Any) -> Any:
        assert self.action_space.contains(np.int64(action))
        return self.env.step(action - 5)


def register_env(
    monkeypatch: pytest.MonkeyPatch, entry_point: Callable[..., Any], **values: Any
) -> str:
    """Register an environment until the end of the test, and return its id."""
    defaults = {"reward_threshold": 99.0, "max_episode_steps": 10}
    spec = EnvSpec("test/Custom-v0", entry_point=entry_point, **(defaults | values))
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    return spec.id
