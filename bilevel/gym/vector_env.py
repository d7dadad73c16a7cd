"""Many copies of an SE as one vector environment of gymnasium."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.gym.env import SyntheticEnv
from bilevel.kernels.synthetic_env import DONE, step_all, work_space
from bilevel.tasks import checked_action


class SyntheticVectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """N copies of the SE of a file that take their steps in one compiled loop:
    `gymnasium.make_vec("bilevel/SyntheticEnv-v0", num_envs=N, path=...)`.

    It gives what gymnasium's SyncVectorEnv of N single ones gives; a copy
    whose episode has ended is reset by the next step. Raises InvalidInput as SyntheticEnv does.
    """

    metadata = {  # noqa: RUF012
        "render_modes": [],
        "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self, path: str | Path | None = None, num_envs: int = 1, render_mode: str | None = None
    ) -> None:
        if render_mode is not None:
            raise InvalidInput(
                f"render_mode {render_mode!r} needs one environment after the other: "
                'gymnasium.make_vec(..., vectorization_mode="sync")'
            )
        if num_envs < 1:
            raise InvalidInput(f"num_envs must be at least 1; got {num_envs}")
        single = SyntheticEnv(path)
        self.num_envs = num_envs
        self.single_observation_space = single.observation_space
        self.single_action_space = single.action_space
        self.observation_space = batch_space(single.observation_space, num_envs)
        self.action_space = batch_space(single.action_space, num_envs)
        self._single = single
        self._sources = [np.random.default_rng() for _ in range(num_envs)]
        self._work = work_space(single.kernel)
        self._states = np.zeros((num_envs, single.se.architecture.state_size), np.float32)
        self._steps = np.zeros(num_envs, np.int64)
        self._over = np.zeros(num_envs, bool)
        self._begun = False

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draw initial states (N, S); with one seed, copy i has the seed + i. Of the options,
        `reset_mask` (N,) tells which copies are reset; the first reset is of all.

        Raises ValueError for another number of seeds than of copies, and InvalidInput for another
        mask.
        """
        if seed is None:
            seeds: Sequence[int | None] = [None] * self.num_envs
        elif isinstance(seed, int | np.integer):
            seeds = [int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"{len(seeds)} seeds for {self.num_envs} copies of the SE")
        everyone = np.ones(self.num_envs, bool)
        some = (options or {}).get("reset_mask", everyone) if self._begun else everyone
        mask = np.asarray(some)
        if mask.dtype != bool or mask.shape != everyone.shape:
            raise InvalidInput(
                f"reset_mask must be {self.num_envs} booleans, one a copy of the SE; got {some!r}"
            )
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None:
                self._sources[i], _ = seeding.np_random(seeds[i])
        self._begin(np.flatnonzero(mask))
        self._begun = True
        self._over &= ~mask
        return self._states.copy(), {}

    def step(
        self, actions: Any
    ) -> tuple[
        NDArray[np.float32],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, Any],
    ]:
        """Take one step of every copy with actions (N,): next observations (N, S), rewards (N,),
        terminated (N,), truncated (N,), info.

        Raises InvalidInput for a wrong action, and ResetNeeded before the first reset.
        """
        if not self._begun:
            raise ResetNeeded("call reset before step")
        if np.shape(actions) != (self.num_envs,):
            raise InvalidInput(
                f"actions of the shape {np.shape(actions)} for {self.num_envs} copies of the SE"
            )
        resetting = self._over
        numbers = self._numbers(actions, resetting)
        states, rewards, dones = np.empty_like(self._states), *np.empty((2, self.num_envs))
        step_all(self._single.kernel, self._states, numbers, states, rewards, dones, self._work)
        self._states = states
        self._steps += 1
        terminated = (dones > DONE) & ~resetting
        truncated = (self._steps >= self._single.step_limit) & ~resetting
        self._begin(np.flatnonzero(resetting))
        self._over = terminated | truncated
        rewards[resetting] = 0.0
        info = {"done": np.where(resetting, 0.0, dones), "_done": ~resetting}
        return self._states.copy(), rewards, terminated, truncated, info

    def _numbers(self, actions: Any, resetting: NDArray[np.bool_]) -> NDArray[np.int64]:
        """The actions (N,), checked; copies that are reset take none."""
        n_actions, first = self._single.n_actions, self._single.first_action
        numbers, end = np.asarray(actions), first + n_actions
        if numbers.dtype.kind in "iu" and ((numbers >= first) & (numbers < end)).all():
            numbers = numbers.astype(np.int64) - first
        else:
            numbers = np.array(
                [
                    0 if over else checked_action(action, n_actions, first)
                    for action, over in zip(actions, resetting, strict=True)
                ]
            )
        return np.where(resetting, 0, numbers).astype(np.int64)

    def close_extras(self, **kwargs: Any) -> None:
        """Close the real task's environment."""
        self._single.close()

    def _begin(self, which: NDArray[np.int64]) -> None:
        for i in which:
            self._states[i] = self._single.initial_state(self._sources[i])
            self._steps[i] = 0
