"""A real task: a gymnasium environment and the values that the method needs.

CartPole-v0 and Acrobot-v1 have compiled dynamics. Gymnasium runs the dynamics of all other tasks:
in tests, for initial states, and in training on the real task.
"""

from contextlib import closing, nullcontext
from dataclasses import dataclass
from typing import Self

import gymnasium
import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

from bilevel.kernels import dynamics
from bilevel.tasks.adapter import CheckedEnv, RealEnv, make_env
from bilevel.tasks.compiled import SIMULATORS, Labels
from bilevel.user_code import digest_of

#: Maximum number of initial states drawn from an environment that gymnasium runs; training episodes
#: cycle through them. Compiled tasks draw one state per episode.
GYMNASIUM_INITIAL_STATES = 200

#: Maximum step limit of a task.
MAX_STEP_LIMIT = 1_000_000

#: Random steps that measure the scale of observations: of a compiled task, and of a task that
#: gymnasium runs, whose steps may be slow. With 1000 steps, CartPole takes about 1.4 times as many
#: core seconds per SE as with 100 000 (docs/nes.md).
SCALE_STEPS, GYMNASIUM_SCALE_STEPS = 100_000, 10_000

#: Range of an observation, relative to its mean, up to which it counts as constant.
_CONSTANT = 1e-6


@dataclass(frozen=True)
class ObservationScale:
    """Mean and standard deviation (S,) of a task's observations under random actions."""

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    real_env_steps: int  # steps that measured them

    @classmethod
    def of(cls, observations: NDArray[np.float32]) -> Self:
        """Return the scale of observations (n, S); a constant one has standard deviation 1."""
        seen = observations.astype(np.float64)
        mean, deviation = seen.mean(axis=0), seen.std(axis=0)
        # Rounding errors: the computed deviation of a constant is not always 0.
        constant = np.ptp(seen, axis=0) <= _CONSTANT * np.maximum(np.abs(mean), 1.0)
        deviation = np.where(constant, 1.0, deviation)
        return cls(mean.astype(np.float32), deviation.astype(np.float32), len(seen))


@dataclass(frozen=True)
class Task:
    """Fixed values of a real task, as `get_task` returns them."""

    id: str
    state_size: int
    n_actions: int
    step_limit: int  # maximum number of environment steps per episode
    solved_reward: float  # mean return at which the task counts as solved
    worst_score: float  # score of a diverged agent
    dynamics: int = dynamics.OBSERVED  # code of the compiled dynamics, if any

    @property
    def compiled(self) -> bool:
        """True if the task's dynamics are compiled."""
        return self.dynamics != dynamics.OBSERVED

    @property
    def code_digest(self) -> str | None:
        """Digest of the user's code that defines the task; None for gymnasium's own tasks."""
        if self.compiled:
            return None
        entry = gymnasium.spec(self.id.rpartition(":")[2]).entry_point  # its module is imported
        return digest_of("gymnasium", load_env_creator(entry) if isinstance(entry, str) else entry)

    @property
    def labels(self) -> Labels:
        """Names of observations and actions; tasks without compiled dynamics have numbers."""
        if self.compiled:
            return SIMULATORS[self.dynamics].labels
        observations = tuple(f"observation {i}" for i in range(self.state_size))
        actions = tuple(f"action {i}" for i in range(self.n_actions))
        return Labels(observations, actions, axes=(0, min(1, self.state_size - 1)))

    def make(self, render_mode: str | None = None) -> RealEnv:
        """Create the gymnasium environment, truncated at this task's step limit."""
        env = make_env(self.id, self.step_limit, render_mode)
        return env if self.compiled else CheckedEnv(env, self.id)

    def try_out(self) -> None:
        """Reset the environment and take each action once. Raises UserCodeError."""
        with closing(self.make()) as env:
            first = int(env.action_space.start)  # type: ignore[attr-defined]
            for action in range(self.n_actions):
                env.reset(seed=0)
                env.step(np.int64(first + action))

    def initial_physics(
        self, rng: np.random.Generator, n: int, env: RealEnv | None = None
    ) -> NDArray[np.float64]:
        """Draw `n` initial states (n, p) from the task's reset distribution: states of the
        simulator of a compiled task, else at most `GYMNASIUM_INITIAL_STATES` observations after
        resets of `env` (by default of a new environment)."""
        if self.compiled:
            return SIMULATORS[self.dynamics].initial_physics(rng, n)
        seed = int(rng.integers(2**31))
        with closing(self.make()) if env is None else nullcontext(env) as env:
            states = [env.reset(seed=seed)[0]]
            states += [env.reset()[0] for _ in range(min(n, GYMNASIUM_INITIAL_STATES) - 1)]
        return np.array(states, np.float64)

    def observe(self, physics: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the observation (S,) of one row of `initial_physics`."""
        state = np.empty(self.state_size, np.float32)
        dynamics.observe(self.dynamics, physics, state)
        return state

    def physics(self, state: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the state (p,) of a compiled task's simulator at an observation (S,)."""
        return SIMULATORS[self.dynamics].physics(state)

    @property
    def unit_scale(self) -> ObservationScale:
        """Mean 0 and standard deviation 1, for SEs that do not use the scale."""
        zero = np.zeros(self.state_size, np.float32)
        return ObservationScale(zero, np.ones_like(zero), 0)

    def observation_scale(self, seed: int) -> ObservationScale:
        """Measure the scale of observations under random actions, in `SCALE_STEPS` steps of a
        compiled task and `GYMNASIUM_SCALE_STEPS` steps of others."""
        if self.compiled:
            return ObservationScale.of(self._simulated_observations(seed, SCALE_STEPS))
        return ObservationScale.of(self._gymnasium_observations(seed, GYMNASIUM_SCALE_STEPS))

    def _simulated_observations(self, seed: int, steps: int) -> NDArray[np.float32]:
        rng = np.random.default_rng(seed)
        actions = rng.integers(self.n_actions, size=steps)
        seen = np.empty((steps, self.state_size), np.float32)
        initial = self.initial_physics(rng, steps)  # at most one episode per step
        dynamics.observe_episodes(self.dynamics, self.step_limit, actions, initial, seen)
        return seen

    def _gymnasium_observations(self, seed: int, steps: int) -> NDArray[np.float32]:
        seen = np.empty((steps, self.state_size), np.float32)
        with closing(self.make()) as env:
            env.action_space.seed(seed % 2**31)
            seen[0], _ = env.reset(seed=seed % 2**31)
            for t in range(1, steps):
                seen[t], _, terminated, truncated, _ = env.step(env.action_space.sample())
                if terminated or truncated:
                    seen[t], _ = env.reset()
        return seen
