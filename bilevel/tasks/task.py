"""A real task: a gymnasium environment and the values that the method needs.

Gymnasium's classic control tasks have compiled dynamics. Gymnasium runs all other tasks: in tests,
for initial states, and in training on the real task.
"""

import atexit
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Self

import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

from bilevel.kernels import dynamics
from bilevel.seeds import Purpose, derive
from bilevel.tasks.adapter import RealEnv
from bilevel.tasks.compiled import SIMULATORS, Labels
from bilevel.tasks.source import EnvSource, GymEnv
from bilevel.user_code import UserCodeError, digest_of

#: Maximum number of initial states drawn from an environment that gymnasium runs; training episodes
#: cycle through them. Compiled tasks draw one state per episode.
GYMNASIUM_INITIAL_STATES = 200

#: Maximum step limit of a task.
MAX_STEP_LIMIT = 1_000_000

#: Core seconds of a step, unless they are measured: of a compiled task and of a Python environment.
COMPILED_STEP_SECONDS, STEP_SECONDS = 1e-6, 5e-5

#: Random steps that measure the scale of observations: at first, and at most.
SCALE_STEPS, MAX_SCALE_STEPS = 1_000, 8_000

#: Difference between two measurements of the scale, in standard deviations, up to which they agree.
_SCALE_TOLERANCE = 0.2

#: Random steps that validate a task.
TRIAL_STEPS = 20

#: Range of an observation, relative to its mean, up to which it counts as constant.
_CONSTANT = 1e-6


#: The environment that a thread has open (`env`), with its task and specification (`key`).
_OPEN = threading.local()


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

    def agrees(self, other: "ObservationScale") -> bool:
        """Return whether two measurements differ little."""
        unit = _SCALE_TOLERANCE * np.maximum(self.deviation, other.deviation)
        same_mean = np.abs(self.mean - other.mean) <= unit
        return bool((same_mean & (np.abs(self.deviation - other.deviation) <= unit)).all())


@dataclass(frozen=True)
class Task:
    """Fixed values of a real task, as `get_task` returns them."""

    id: str  # `EnvSource` as text: gymnasium's id, with keyword arguments and wrappers
    state_size: int
    action_size: int  # number of actions, or length of an action vector
    step_limit: int  # maximum number of environment steps per episode
    solved_reward: float  # mean return at which the task counts as solved
    worst_score: float  # score of a diverged agent
    dynamics: int = dynamics.OBSERVED  # code of the compiled dynamics, if any
    continuous: bool = False  # whether actions are vectors in [-1, 1]
    measured_step_seconds: float | None = None  # core seconds of a step, if they were measured

    @property
    def compiled(self) -> bool:
        """True if the task's dynamics are compiled."""
        return self.dynamics != dynamics.OBSERVED

    @property
    def source(self) -> EnvSource:
        """How gymnasium makes the environment."""
        return EnvSource.parse(self.id)

    @property
    def step_seconds(self) -> float:
        """Core seconds of a step, measured or typical."""
        typical = COMPILED_STEP_SECONDS if self.compiled else STEP_SECONDS
        return typical if self.measured_step_seconds is None else self.measured_step_seconds

    @property
    def code_digest(self) -> str | None:
        """Digest of the user's code that defines the task; None for gymnasium's own tasks."""
        if self.compiled:
            return None
        spec = self.source.spec  # its module is imported
        code = [*self.source.wrappers] + ([spec.entry_point] if spec and spec.entry_point else [])
        loaded = (load_env_creator(part) if isinstance(part, str) else part for part in code)
        return digest_of("gymnasium", *loaded)

    @property
    def labels(self) -> Labels:
        """Names of observations and actions; tasks without compiled dynamics have numbers."""
        if self.compiled:
            return SIMULATORS[self.dynamics].labels
        observations = tuple(f"observation {i}" for i in range(self.state_size))
        actions = tuple(f"action {i}" for i in range(self.action_size))  # or its dimensions
        return Labels(observations, actions, axes=(0, min(1, self.state_size - 1)))

    def make(self, render_mode: str | None = None) -> GymEnv:
        """Create the gymnasium environment, truncated at this task's step limit."""
        return self.source.make(self.step_limit, render_mode)

    def real_env(self) -> RealEnv:
        """Create the environment with states and actions as agents use them."""
        return RealEnv(self.make(), self.id)

    @contextmanager
    def shared_env(self) -> Iterator[RealEnv]:
        """Context with this thread's environment of the task. It stays open until the thread needs
        another task's, because some simulators start slowly; an error closes it."""
        key = self, self.source.spec
        if getattr(_OPEN, "key", None) != key:
            close_shared_env()
            _OPEN.env, _OPEN.key = self.real_env(), key
        try:
            yield _OPEN.env
        except BaseException:
            close_shared_env()
            raise

    def try_out(self) -> float:
        """Take some random steps; return the median time of a step or reset in seconds. Raises
        UserCodeError for errors and invalid values, and for observations that change by less than
        float32 can represent."""
        seconds = []
        with closing(self.real_env()) as env:
            env.env.action_space.seed(0)
            seen, over = [env.raw_reset(seed=0)], False
            for _ in range(TRIAL_STEPS):
                started = time.perf_counter()
                state, over = (env.raw_reset(), False) if over else env.random_step()
                seconds.append(time.perf_counter() - started)
                seen.append(state)
        check_resolution(np.array(seen, np.float64), self.id)
        return float(np.median(seconds))

    def initial_physics(
        self, rng: np.random.Generator, n: int, env: RealEnv | None = None
    ) -> NDArray[np.float64]:
        """Draw `n` initial states (n, p) from the task's reset distribution: states of the
        simulator of a compiled task, else at most `GYMNASIUM_INITIAL_STATES` observations after
        resets of `env` (default: the shared environment)."""
        if self.compiled:
            return SIMULATORS[self.dynamics].initial_physics(rng, n)
        seed = int(rng.integers(2**31))
        with self.shared_env() if env is None else nullcontext(env) as env:
            states = [env.reset(seed)]
            states += [env.reset() for _ in range(min(n, GYMNASIUM_INITIAL_STATES) - 1)]
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

    def observation_scale(
        self, seed: int, on_step: Callable[[], None] = lambda: None
    ) -> ObservationScale:
        """Measure the scale of observations under random actions. The number of steps doubles,
        from `SCALE_STEPS` to `MAX_SCALE_STEPS`, until both halves agree. Gymnasium's tasks call
        `on_step` after each step."""
        measure = self._simulated_observations if self.compiled else self._gymnasium_observations
        seen, agree = measure(derive(seed, Purpose.OBSERVATIONS, 0), SCALE_STEPS, on_step), False
        while len(seen) < MAX_SCALE_STEPS and not agree:
            before = len(seen)
            more = measure(derive(seed, Purpose.OBSERVATIONS, before), before, on_step)
            agree = ObservationScale.of(seen).agrees(ObservationScale.of(more))
            seen = np.concatenate([seen, more])
        return ObservationScale.of(seen)

    def _simulated_observations(
        self, seed: int, steps: int, on_step: Callable[[], None]
    ) -> NDArray[np.float32]:
        rng = np.random.default_rng(seed)
        if self.continuous:
            actions = rng.uniform(-1.0, 1.0, steps)
        else:
            actions = rng.integers(self.action_size, size=steps).astype(np.float64)
        seen = np.empty((steps, self.state_size), np.float32)
        initial = self.initial_physics(rng, steps)  # at most one episode per step
        dynamics.observe_episodes(self.dynamics, self.step_limit, actions, initial, seen)
        return seen

    def _gymnasium_observations(
        self, seed: int, steps: int, on_step: Callable[[], None]
    ) -> NDArray[np.float32]:
        seen = np.empty((steps, self.state_size), np.float32)
        with self.shared_env() as env:
            env.env.action_space.seed(seed % 2**31)
            state, over = env.raw_reset(seed % 2**31), False
            for t in range(steps):
                if over:
                    state = env.raw_reset()
                seen[t] = state
                state, over = env.random_step()
                on_step()
        return seen


def close_shared_env() -> None:
    """Close the environment that this thread has open, if any."""
    _OPEN.key = None
    if (env := getattr(_OPEN, "env", None)) is not None:
        _OPEN.env = None
        env.close()


atexit.register(close_shared_env)


def check_resolution(seen: NDArray[np.float64], name: str) -> None:
    """Raise UserCodeError if consecutive observations (n, S) differ by less than the distance
    between neighbouring float32 numbers, as those of a clock in seconds do."""
    spacing = np.spacing(np.abs(seen).max(axis=0).astype(np.float32))
    changes = np.abs(np.diff(seen, axis=0))
    for i in np.flatnonzero((changes > 0).any(axis=0)):
        typical = float(np.median(changes[changes[:, i] > 0, i]))
        if typical < spacing[i]:
            raise UserCodeError(
                f"task {name!r}: observation {i} is near {seen[-1, i]:g} and changes by "
                f"{typical:g}, which float32 cannot represent: subtract a constant in the task"
            )
