"""Specification of a task by its gymnasium id."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from numbers import Integral
from typing import Any

import gymnasium
from gymnasium.envs.registration import EnvSpec

from bilevel.errors import InvalidInput, first_line, is_number
from bilevel.kernels import dynamics
from bilevel.spaces import Actions, Observations
from bilevel.tasks.source import EnvSource, GymEnv, registered
from bilevel.tasks.task import MAX_STEP_LIMIT, Task
from bilevel.user_code import user_code_errors

_P = "gymnasium.envs.classic_control"
#: Codes of the compiled dynamics by gymnasium's entry points.
_COMPILED = {
    f"{_P}.cartpole:CartPoleEnv": dynamics.CARTPOLE,
    f"{_P}.acrobot:AcrobotEnv": dynamics.ACROBOT,
    f"{_P}.mountain_car:MountainCarEnv": dynamics.MOUNTAIN_CAR,
    f"{_P}.continuous_mountain_car:Continuous_MountainCarEnv": dynamics.CONTINUOUS_MOUNTAIN_CAR,
    f"{_P}.pendulum:PendulumEnv": dynamics.PENDULUM,
}

#: Tasks with compiled dynamics by id. CartPole-v0 and Acrobot-v1 have the paper's values (Table
#: "Fixed hyperparameters"). Gymnasium specifies no solved reward for Pendulum.
BUILT_IN_TASKS = {
    task.id: task
    for task in (
        Task("CartPole-v0", 4, 2, 200, 195.0, 0.0, dynamics.CARTPOLE),
        Task("CartPole-v1", 4, 2, 500, 475.0, 0.0, dynamics.CARTPOLE),
        Task("Acrobot-v1", 6, 3, 500, -100.0, -500.0, dynamics.ACROBOT),
        Task("MountainCar-v0", 2, 3, 200, -110.0, -200.0, dynamics.MOUNTAIN_CAR),
        Task(
            *("MountainCarContinuous-v0", 2, 1, 999, 90.0, -100.0),
            dynamics.CONTINUOUS_MOUNTAIN_CAR,
            continuous=True,
        ),
        Task("Pendulum-v1", 3, 1, 200, -200.0, -2000.0, dynamics.PENDULUM, continuous=True),
    )
}


def get_task(
    env: str | EnvSpec | Callable[..., GymEnv],
    solved_reward: float | None = None,
    step_limit: int | None = None,
    worst_score: float | None = None,
    *,
    env_kwargs: Mapping[str, Any] | None = None,
    wrappers: Sequence[str] = (),
) -> Task:
    """Return the task of a gymnasium environment.

    Gymnasium's classic control tasks have compiled dynamics; gymnasium runs all others.
    Observations may be Box, Discrete, MultiDiscrete, MultiBinary, and Tuple and Dict of these,
    except for images. Actions may be Discrete or a bounded Box of floats.

    Args:
        env: Gymnasium's id, such as `CartPole-v0`; `MODULE:ID` for an environment that a module
            registers; the id with keyword arguments, such as `FrozenLake-v1,is_slippery=False`; a
            specification; or a class or function, which is registered under its name.
        solved_reward: Mean return that solves the task. Default: `reward_threshold`.
        step_limit: Maximum steps of an episode. Default: `max_episode_steps`.
        worst_score: Score of a diverged agent, below the solved reward. Default: 0 if the solved
            reward is positive, else -1 per step, or twice the solved reward if that is lower.
        env_kwargs: Keyword arguments of the environment.
        wrappers: Wrappers of the environment as `MODULE:CLASS`, the innermost first. A class must
            need no other argument than the environment.

    Raises:
        InvalidInput: The id is unknown, the spaces are not supported, a value is out of range, or
            neither the arguments nor the environment specify the solved reward and the step limit.
    """
    if isinstance(env, EnvSpec):
        solved_reward = env.reward_threshold if solved_reward is None else solved_reward
        step_limit = env.max_episode_steps if step_limit is None else step_limit
    text = env if isinstance(env, str) else str(registered(env))
    source = EnvSource.of(text, env_kwargs or {}, wrappers)
    task_id = str(source)
    built_in = BUILT_IN_TASKS.get(task_id)
    if built_in is not None and (solved_reward, step_limit, worst_score) == (None, None, None):
        return built_in
    spec, observations, actions = _inspect(source)
    default_solved = built_in.solved_reward if built_in else spec.reward_threshold
    solved: Any = default_solved if solved_reward is None else solved_reward
    limit: Any = spec.max_episode_steps if step_limit is None else step_limit
    worst = _default_worst_score(solved, limit) if worst_score is None else worst_score
    _check_values(task_id, solved, limit, worst)
    unchanged = not (spec.kwargs or spec.additional_wrappers)
    code = _COMPILED.get(str(unchanged and spec.entry_point), dynamics.OBSERVED)
    sizes = observations.size, actions.size, int(limit)
    return Task(task_id, *sizes, float(solved), float(worst), code, actions.continuous)


def _check_values(task_id: str, solved: Any, limit: Any, worst: Any) -> None:
    """Raise InvalidInput for values that are missing, of the wrong type or out of range."""
    if solved is None or limit is None:
        missing = "solved-reward" if solved is None else "step-limit"
        raise InvalidInput(
            f"{task_id} does not specify its {missing.replace('-', ' ')}: give --{missing}, or "
            f"{missing.replace('-', '_')}=... to bilevel.get_task"
        )
    if not is_number(solved) or not math.isfinite(solved):
        raise InvalidInput(f"{task_id}: solved reward must be a finite number; got {solved!r}")
    if not is_number(limit, Integral) or not 1 <= limit <= MAX_STEP_LIMIT:
        raise InvalidInput(f"{task_id}: step limit must be 1 to {MAX_STEP_LIMIT}; got {limit!r}")
    if not is_number(worst) or not -math.inf < worst < solved:
        raise InvalidInput(
            f"{task_id}: worst score must be finite and below the solved reward, {solved:g}; "
            f"got {worst!r}"
        )


def _default_worst_score(solved_reward: Any, step_limit: Any) -> float:
    """Return the default, or NaN for values that are not numbers."""
    if not (is_number(solved_reward) and is_number(step_limit)):
        return math.nan
    if solved_reward > 0:
        return 0.0
    return -float(step_limit) if -step_limit < solved_reward else 2 * float(solved_reward)


def _inspect(source: EnvSource) -> tuple[EnvSpec, Observations, Actions]:
    """Return spec, observations and actions of a task. Raises InvalidInput."""
    task_id = str(source)
    unknown = env = extra = None
    with user_code_errors(f"task {task_id!r}", "is created"):
        try:
            env = source.make()
        except (gymnasium.error.DependencyNotInstalled, ImportError):
            extra = _extra(source.spec)
            if extra is None:
                raise
        except gymnasium.error.Error as error:
            unknown = first_line(error)
    if extra is not None:
        raise InvalidInput(
            f'{task_id} needs the extra {extra}: pip install ".[{extra}]", or make setup '
            f"EXTRAS={extra}"
        )
    if env is None or env.spec is None:
        raise InvalidInput(
            f"unknown task {task_id!r}: allowed are {', '.join(BUILT_IN_TASKS)} "
            f"and gymnasium ids ({unknown})"
        )
    with closing(env):
        if env.spec.id != source.registered_id:  # gymnasium adds the latest version
            raise InvalidInput(f"task {task_id!r} has no version, such as {env.spec.id}")
        return (
            env.spec,
            Observations(env.observation_space, task_id),
            Actions(env.action_space, task_id),
        )


def _extra(spec: EnvSpec | None) -> str | None:
    """Return the extra of this package that installs the dependencies of a gymnasium task."""
    entry = str(spec and spec.entry_point)
    return next((name for name in ("mujoco", "box2d") if f"gymnasium.envs.{name}." in entry), None)
