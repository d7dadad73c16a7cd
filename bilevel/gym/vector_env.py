"""Copies of an SE as a gymnasium vector environment."""

from collections.abc import Iterator, Sequence
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

_Floats = NDArray[np.float32]

#: Initial states for which a copy draws noise at a time.
NOISE_BLOCK = 64


class SyntheticVectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """N copies of an SE whose steps run in one compiled loop.

    `gymnasium.make_vec("bilevel/SyntheticEnv-v0", num_envs=N, path=...)` creates it. Observations,
    rewards and ends are the same as in a SyncVectorEnv of N `SyntheticEnv` copies; the step after
    the end of an episode resets the copy. Raises InvalidInput as SyntheticEnv does.
    """

    metadata = {"autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self, path: str | Path | None = None, num_envs: int = 1, render_mode: str | None = None
    ) -> None:
        if render_mode is not None:
            raise InvalidInput('rendering needs vectorization_mode="sync"')
        self._single = single = SyntheticEnv(path)
        self.num_envs = num_envs
        self.single_observation_space = single.observation_space
        self.single_action_space = single.action_space
        self.observation_space = batch_space(single.observation_space, num_envs)
        self.action_space = batch_space(single.action_space, num_envs)
        self._rngs = [np.random.default_rng() for _ in range(num_envs)]
        self._noise = [self._draw(rng) for rng in self._rngs]
        self._work = work_space(single.kernel)
        self._states: _Floats | None = None  # (N, S)
        self._steps = np.zeros(num_envs, np.int64)
        self._ended = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode in all copies and return initial observations and info.

        With a single seed, copy i uses seed + i. Raises ValueError if the number of seeds is not N.
        """
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"{len(seeds)} seeds for {self.num_envs} copies of the SE")
        for i, number in enumerate(seeds):
            if number is not None:
                self._rngs[i], _ = seeding.np_random(number)
                self._noise[i] = self._draw(self._rngs[i])
        self._states = self._initial_states(range(self.num_envs))
        self._steps[:] = 0
        self._ended[:] = False
        return self._single.observations.unflatten_all(self._states), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Take one step in every copy.

        Returns observations, rewards (N,), terminated (N,), truncated (N,) and info. Raises
        InvalidInput for an invalid action, and ResetNeeded before the first reset.
        """
        if self._states is None:
            raise ResetNeeded("call reset before step")
        single, resetting = self._single, self._ended
        states, rewards, dones = np.empty_like(self._states), *np.empty((2, self.num_envs))
        inward = single.actions.inward_all(actions, self.num_envs)
        step_all(single.kernel, self._states, inward, states, rewards, dones, self._work)
        self._states = states
        self._steps += 1
        if resetting.any():
            states[resetting] = self._initial_states(np.flatnonzero(resetting).tolist())
            self._steps[resetting] = 0
            rewards[resetting] = dones[resetting] = 0.0
        terminated = dones > DONE
        truncated = ~terminated & (self._steps >= single.step_limit)
        self._ended = terminated | truncated
        info = {"done": dones, "_done": ~resetting}
        return single.observations.unflatten_all(states), rewards, terminated, truncated, info

    def _draw(self, rng: np.random.Generator) -> Iterator[_Floats]:
        """Draw the noise (S,) of own initial states, many at a time."""
        while True:
            shape = NOISE_BLOCK, self._single.se.se.architecture.state_size
            yield from rng.standard_normal(shape, np.float32)

    def _initial_states(self, copies: Sequence[int]) -> _Floats:
        """Draw the initial states (n, S) of these copies, each from its own generator."""
        se = self._single.se.se
        if se.architecture.own_initial_states:
            return se.initial_states_of(np.stack([next(self._noise[i]) for i in copies]))
        return np.stack([self._single.initial_state(self._rngs[i]) for i in copies])

    def close_extras(self, **kwargs: Any) -> None:
        """Close the real task's environment."""
        self._single.close()
