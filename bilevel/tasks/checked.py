"""Checks of real tasks that users write: what they return, and what they raise."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from bilevel.user_code import as_mistake, mistake_at


class CheckedEnv(gymnasium.Wrapper[NDArray[np.float32], np.int64, NDArray[np.float32], np.int64]):
    """An environment of the task `task_id`; its methods raise Mistake for errors, for observations
    of other sizes than its space has, and for values that are not finite."""

    def __init__(self, env: gymnasium.Env[NDArray[np.float32], np.int64], task_id: str) -> None:
        super().__init__(env)
        self._what = f"task {task_id!r}"
        self._failed = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """See gymnasium."""
        code = type(self.unwrapped).reset
        with self._checked(code, "is reset"):
            state, info = self.env.reset(seed=seed, options=options)
            checked = self._observation(state, code)
        return checked, info

    def step(
        self, action: np.int64
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """See gymnasium."""
        code = type(self.unwrapped).step
        with self._checked(code, "takes a step"):
            state, reward, terminated, truncated, info = self.env.step(action)
            checked, number = self._observation(state, code), float(reward)
            if isinstance(reward, str):
                raise mistake_at(self._what, code, f"the reward is {reward!r}: no number")
            if not np.isfinite(number):
                raise mistake_at(self._what, code, f"the reward is {number}: it must be finite")
        return checked, number, bool(terminated), bool(truncated), info

    def close(self) -> None:
        """See gymnasium. Errors after others, which may be their cause, are ignored."""
        with (
            suppress(Exception, SystemExit)
            if self._failed
            else self._checked(type(self.unwrapped).close, "is closed")
        ):
            self.env.close()

    @contextmanager
    def _checked(self, code: Callable[..., Any], doing: str) -> Iterator[None]:
        try:
            with as_mistake(self._what, code, doing):
                yield
        except BaseException:  # also Ctrl-C
            self._failed = True
            raise

    def _observation(self, state: Any, code: Any) -> NDArray[np.float32]:
        # A copy: a task may write its next observation into the same array.
        array, shape = np.array(state), self.observation_space.shape
        if array.shape != shape:
            raise mistake_at(
                self._what,
                code,
                f"an observation has the shape {array.shape}: its space has {shape}",
            )
        if not np.isfinite(array).all():
            told = np.array2string(array, threshold=8)
            raise mistake_at(self._what, code, f"an observation is {told}: it must be finite")
        return array
