"""A real task: a gymnasium environment and the values that the method needs of it.

CartPole-v0 and Acrobot-v1 have the paper's fixed values (Table "Fixed hyperparameters") and
compiled dynamics. Any other gymnasium id works too, if its observations are a flat Box and its
actions Discrete; gymnasium then runs its dynamics, in tests, for initial states, and in training on
the real task.
"""

import math
import warnings
from contextlib import closing, nullcontext
from dataclasses import dataclass
from functools import cache
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

from bilevel.errors import InvalidInput, first_line, is_number
from bilevel.kernels import dynamics
from bilevel.tasks.checked import CheckedEnv
from bilevel.user_code import as_mistake, digest_of

#: A real task in gymnasium.
RealEnv = gymnasium.Env[NDArray[np.float32], np.int64]

#: Maximum number of initial states drawn from an environment that gymnasium runs (training episodes
#: cycle through them); compiled tasks draw one per episode.
GYMNASIUM_INITIAL_STATES = 200


#: Upper bound on the step limit of any task.
MAX_STEP_LIMIT = 1_000_000


#: Random steps on the real task that measure the scale of its observations: of a compiled task, and
#: of one that gymnasium runs, whose steps may be slow. With 1000 of them some runs on CartPole take
#: several times as long as with 100 000 (docs/nes.md).
SCALE_STEPS, GYMNASIUM_SCALE_STEPS = 100_000, 10_000

#: Range of an observation, relative to its mean, up to which it counts as constant.
_CONSTANT = 1e-6


@dataclass(frozen=True)
class ObservationScale:
    """Mean and standard deviation (S,) of a task's observations under random actions."""

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    real_env_steps: int  # made to measure them


@dataclass(frozen=True)
class Task:
    """Fixed values of a real task.

    `worst_score` is the score of a diverged agent: the lowest possible return, or what `get_task`
    takes for it (see also `bilevel.evaluation.scores_of`).
    """

    id: str
    state_size: int
    n_actions: int
    step_limit: int  # maximum number of environment steps per episode
    solved_reward: float  # mean return at which the task counts as solved
    worst_score: float
    dynamics: int = dynamics.OBSERVED  # code of the compiled dynamics, if any

    @property
    def compiled(self) -> bool:
        """Whether the task's dynamics are compiled."""
        return self.dynamics != dynamics.OBSERVED

    def make(self, render_mode: str | None = None) -> RealEnv:
        """The gymnasium environment, truncated at this task's step limit."""
        env = _make(self.id, self.step_limit, render_mode)
        return env if self.compiled else CheckedEnv(env, self.id)

    @property
    def code_digest(self) -> str | None:
        """Digest of the user's code that defines it; None for a task of gymnasium's. It is that of
        the file when it was first asked for: the process goes on with the code that it has
        imported."""
        return None if self.compiled else _code_digest(self.id)

    def try_out(self) -> None:
        """Reset the real task, unless it is compiled, and take a step by each action. Raises
        Mistake."""
        if self.compiled:
            return
        env = _make(self.id, self.step_limit, checked=True)
        with closing(CheckedEnv(env, self.id)) as env:
            first = int(env.action_space.start)  # type: ignore[attr-defined]
            for action in range(self.n_actions):
                env.reset(seed=0)
                env.step(np.int64(first + action))

    def initial_physics(
        self, rng: np.random.Generator, n: int, env: RealEnv | None = None
    ) -> NDArray[np.float64]:
        """`n` draws (n, p) from the task's reset distribution.

        For a compiled task they are states of the simulator; for others they are observations, at
        most `GYMNASIUM_INITIAL_STATES` of them, of resets of `env` or else of a new environment.
        """
        if self.dynamics == dynamics.CARTPOLE:
            return rng.uniform(-0.05, 0.05, (n, 4))
        if self.dynamics == dynamics.ACROBOT:
            return rng.uniform(-0.1, 0.1, (n, 4)).astype(np.float32).astype(np.float64)
        rows = min(n, GYMNASIUM_INITIAL_STATES)
        seed = int(rng.integers(2**31))
        with closing(self.make()) if env is None else nullcontext(env) as resetting:
            first = [resetting.reset(seed=seed)[0]]
            return np.array(first + [resetting.reset()[0] for _ in range(rows - 1)], np.float64)

    def observe(self, physics: NDArray[np.float64]) -> NDArray[np.float32]:
        """The observation (S,) of one row of `initial_physics`."""
        state = np.empty(self.state_size, np.float32)
        dynamics.observe(self.dynamics, physics, state)
        return state

    def physics(self, state: NDArray[np.float32]) -> NDArray[np.float64]:
        """The simulator's state (p,) at an observation (S,) of a compiled task; for others, as in
        `initial_physics`, the observation itself."""
        values = state.astype(np.float64)
        if self.dynamics == dynamics.ACROBOT:
            angles = np.arctan2(values[1], values[0]), np.arctan2(values[3], values[2])
            return np.array([*angles, *values[4:]])
        return values

    @property
    def unit_scale(self) -> ObservationScale:
        """Mean 0 and standard deviation 1, for use where no scale is needed or known."""
        zero = np.zeros(self.state_size, np.float32)
        return ObservationScale(zero, np.ones_like(zero), 0)

    def observation_scale(self, seed: int) -> ObservationScale:
        """Measure the scale of observations over episodes of random actions, SCALE_STEPS or
        GYMNASIUM_SCALE_STEPS in all; the standard deviation of a constant observation is set to
        1."""
        steps = SCALE_STEPS if self.compiled else GYMNASIUM_SCALE_STEPS
        seen = (self._simulated if self.compiled else self._seen)(seed, steps).astype(np.float64)
        mean, deviation = seen.mean(axis=0), seen.std(axis=0)
        # The computed deviation of a constant need not be 0.
        constant = np.ptp(seen, axis=0) <= _CONSTANT * np.maximum(np.abs(mean), 1.0)
        deviation = np.where(constant, 1.0, deviation)
        return ObservationScale(mean.astype(np.float32), deviation.astype(np.float32), steps)

    def _simulated(self, seed: int, steps: int) -> NDArray[np.float32]:
        """Observations (steps, S) of a compiled task under random actions."""
        rng = np.random.default_rng(seed)
        actions = rng.integers(self.n_actions, size=steps)
        seen = np.empty((steps, self.state_size), np.float32)
        initial = self.initial_physics(rng, steps)  # more than there are episodes
        dynamics.observe_episodes(self.dynamics, self.step_limit, actions, initial, seen)
        return seen

    def _seen(self, seed: int, steps: int) -> NDArray[np.float32]:
        """The same of a task that gymnasium runs."""
        seen = np.empty((steps, self.state_size), np.float32)
        with closing(self.make()) as env:
            env.action_space.seed(seed % 2**31)
            seen[0], _ = env.reset(seed=seed % 2**31)
            for place in range(1, steps):
                state, _, terminated, truncated, _ = env.step(env.action_space.sample())
                if terminated or truncated:
                    state, _ = env.reset()
                seen[place] = state
        return seen


@cache
def _code_digest(task_id: str) -> str | None:
    spec = gymnasium.spec(task_id.rpartition(":")[2])  # the module before it is imported
    entries = [spec.entry_point, *(wrapper.entry_point for wrapper in spec.additional_wrappers)]
    code = [load_env_creator(one) if isinstance(one, str) else one for one in entries]
    return digest_of("gymnasium", *code)


BUILT_IN_TASKS = {
    task.id: task
    for task in (
        Task("CartPole-v0", 4, 2, 200, 195.0, 0.0, dynamics.CARTPOLE),
        Task("Acrobot-v1", 6, 3, 500, -100.0, -500.0, dynamics.ACROBOT),
    )
}


def get_task(
    task_id: str,
    solved_reward: float | None = None,
    step_limit: int | None = None,
    worst_score: float | None = None,
) -> Task:
    """The task of that name: a built-in one, or any suitable gymnasium id.

    `solved_reward` and `step_limit` replace the values of the environment's spec. The worst score,
    if it is not given, is assumed to be 0 if the solved reward is positive, else -1 per step, or
    twice the solved reward where that is not below it.

    Raises InvalidInput for an unknown id, unsuitable spaces, a worst score that is not below the
    solved reward, or if neither arguments nor spec give the solved reward and the step limit.
    """
    built_in = BUILT_IN_TASKS.get(task_id)
    if built_in is not None and (solved_reward, step_limit, worst_score) == (None, None, None):
        return built_in
    env, spec = _inspect(task_id)
    with as_mistake(f"task {task_id!r}", type(env.unwrapped).close, "is closed"):
        env.close()
    if spec.id != task_id.rpartition(":")[2]:  # gymnasium completes an id without a version
        ours = {name for name in BUILT_IN_TASKS if name.rpartition("-v")[0] == task_id}
        allowed = ", ".join(sorted({*ours, spec.id}))
        raise InvalidInput(f"task {task_id!r} has no version: allowed are {allowed}")
    with as_mistake(f"task {task_id!r}", type(env.unwrapped), "is asked for its spaces"):
        observations, actions = env.observation_space, env.action_space
    if not isinstance(observations, gymnasium.spaces.Box) or len(observations.shape) != 1:
        raise InvalidInput(
            f"{task_id} has observations {observations}: allowed is a Box of one dimension, as "
            "gymnasium.wrappers.FlattenObservation makes of others"
        )
    if not observations.shape[0]:
        raise InvalidInput(f"{task_id} has observations without components: {observations}")
    if not isinstance(actions, gymnasium.spaces.Discrete):
        raise InvalidInput(
            f"{task_id} has actions {actions}: allowed is Discrete, into which a "
            "gymnasium.ActionWrapper can turn some actions of another space"
        )
    solved = solved_reward if solved_reward is not None else spec.reward_threshold
    limit = step_limit if step_limit is not None else spec.max_episode_steps
    if solved is None or limit is None:
        wanted = {"solved reward": solved, "step limit": limit}
        absent = [what for what, value in wanted.items() if value is None]
        options = (f"--{what.replace(' ', '-')}" for what in absent)
        given = {"solved_reward": solved_reward, "step_limit": step_limit}
        arguments = (
            f"{name}={'...' if name.replace('_', ' ') in absent else repr(value)}"
            for name, value in given.items()
            if value is not None or name.replace("_", " ") in absent
        )
        raise InvalidInput(
            f"{task_id} names no {' and no '.join(absent)}: give {' and '.join(options)}, in "
            f"Python bilevel.get_task({task_id!r}, {', '.join(arguments)})"
        )
    if not is_number(solved) or not math.isfinite(solved):
        raise InvalidInput(f"{task_id}: solved reward must be a finite number; got {solved!r}")
    if not isinstance(limit, int | np.integer) or not 1 <= limit <= MAX_STEP_LIMIT:
        raise InvalidInput(
            f"{task_id}: step limit (--step-limit) must be 1 to {MAX_STEP_LIMIT}; got {limit}"
        )
    if worst_score is None:
        worst_score = 0.0 if solved > 0 else -float(limit)
        worst_score = worst_score if worst_score < solved else 2 * float(solved)
    elif not is_number(worst_score) or not -math.inf < worst_score < solved:
        raise InvalidInput(
            f"{task_id}: worst score (--worst-score) must be finite and below the solved reward, "
            f"{solved:g}; got {worst_score!r}"
        )
    return Task(
        task_id,
        observations.shape[0],
        int(actions.n),
        int(limit),
        float(solved),
        float(worst_score),
        built_in.dynamics if built_in else dynamics.OBSERVED,
    )


def _inspect(
    task_id: str,
) -> tuple[RealEnv, gymnasium.envs.registration.EnvSpec]:
    try:
        env = _make(task_id, None)
    except gymnasium.error.DependencyNotInstalled as error:
        raise InvalidInput(f"task {task_id!r} needs a package: {first_line(error)}") from None
    except gymnasium.error.Error as error:
        raise InvalidInput(
            f"unknown task {task_id!r}: allowed are {', '.join(BUILT_IN_TASKS)} "
            f"and gymnasium ids with a flat Box and Discrete actions ({first_line(error)})"
        ) from None
    except (Exception, SystemExit) as error:  # of the environment's own code
        module = task_id.rpartition(":")[0]
        unknown = (f"No module named {name!r}" for name in (module, module.partition(".")[0]))
        if isinstance(error, ImportError) and str(error).startswith(tuple(unknown)):
            raise InvalidInput(
                f"task {task_id!r} needs the module {module!r}, which cannot be found: the folder "
                "that it is in must be on PYTHONPATH"
            ) from None
        with as_mistake(f"task {task_id!r}", None, "is made"):
            raise
    assert env.spec is not None
    return env, env.spec


def _make(
    task_id: str, step_limit: int | None, render_mode: str | None = None, checked: bool = False
) -> RealEnv:
    """`checked`: with gymnasium's warnings, which it repeats for each environment that is made."""
    # A task without pictures need not know the argument.
    mode: dict[str, Any] = {} if render_mode is None else {"render_mode": render_mode}
    with warnings.catch_warnings():
        # CartPole-v0 is the paper's task: ignore the warning that a newer version exists.
        warnings.filterwarnings("ignore", ".*is out of date", DeprecationWarning)
        warnings.filterwarnings("ignore", ".*out of date", UserWarning)
        warnings.filterwarnings("ignore", ".*latest versioned environment", UserWarning)
        unchecked = None if checked else True
        env: RealEnv = gymnasium.make(task_id, step_limit, disable_env_checker=unchecked, **mode)
        return env
