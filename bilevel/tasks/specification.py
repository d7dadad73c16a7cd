"""Specification of a task by its gymnasium id."""

import math
from contextlib import closing
from numbers import Integral

import gymnasium
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box, Discrete

from bilevel.errors import InvalidInput, first_line, is_number
from bilevel.kernels import dynamics
from bilevel.tasks.adapter import CheckedEnv, make_env
from bilevel.tasks.task import MAX_STEP_LIMIT, Task
from bilevel.user_code import user_code_errors

#: Tasks with compiled dynamics and the paper's values (Table "Fixed hyperparameters") by id.
BUILT_IN_TASKS = {
    "CartPole-v0": Task("CartPole-v0", 4, 2, 200, 195.0, 0.0, dynamics.CARTPOLE),
    "Acrobot-v1": Task("Acrobot-v1", 6, 3, 500, -100.0, -500.0, dynamics.ACROBOT),
}


def get_task(
    task_id: str,
    solved_reward: float | None = None,
    step_limit: int | None = None,
    worst_score: float | None = None,
) -> Task:
    """Return the task with a gymnasium id.

    CartPole-v0 and Acrobot-v1 are built in: they have the paper's values and compiled dynamics. All
    other environments of gymnasium work if their observations are a flat Box and their actions
    Discrete. An id `MODULE:ID` imports a module, which registers the environment.

    Args:
        task_id: Gymnasium's id, such as `CartPole-v0` or `my_package:Balance-v0`.
        solved_reward: Mean return at which the task is solved. Default: the environment's
            `reward_threshold`.
        step_limit: Maximum number of steps of an episode. Default: the environment's
            `max_episode_steps`.
        worst_score: Score of a diverged agent, below the solved reward. Default: 0 if the solved
            reward is positive, else -1 per step, or twice the solved reward if that is lower.

    Raises:
        InvalidInput: The id is unknown, the spaces are not supported, a value is out of range, or
            neither the arguments nor the environment specify the solved reward and the step limit.
    """
    built_in = BUILT_IN_TASKS.get(task_id)
    if built_in is not None and (solved_reward, step_limit, worst_score) == (None, None, None):
        return built_in
    spec, state_size, n_actions = _inspect(task_id)
    solved = spec.reward_threshold if solved_reward is None else solved_reward
    limit = spec.max_episode_steps if step_limit is None else step_limit
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
    worst = _default_worst_score(solved, limit) if worst_score is None else worst_score
    if not is_number(worst) or not -math.inf < worst < solved:
        raise InvalidInput(
            f"{task_id}: worst score must be finite and below the solved reward, {solved:g}; "
            f"got {worst!r}"
        )
    code = built_in.dynamics if built_in else dynamics.OBSERVED
    return Task(task_id, state_size, n_actions, int(limit), float(solved), float(worst), code)


def _default_worst_score(solved_reward: float, step_limit: int) -> float:
    if solved_reward > 0:
        return 0.0
    return -float(step_limit) if -step_limit < solved_reward else 2 * float(solved_reward)


def _inspect(task_id: str) -> tuple[EnvSpec, int, int]:
    """Return spec, number of observations and number of actions of a task. Raises InvalidInput."""
    unknown = spec = None
    with user_code_errors(f"task {task_id!r}", "is created"):
        try:
            with closing(CheckedEnv(make_env(task_id), task_id)) as env:
                spec, observations, actions = env.spec, env.observation_space, env.action_space
        except gymnasium.error.Error as error:
            unknown = first_line(error)
    if spec is None:
        raise InvalidInput(
            f"unknown task {task_id!r}: allowed are {', '.join(BUILT_IN_TASKS)} "
            f"and gymnasium ids with a flat Box and Discrete actions ({unknown})"
        )
    if spec.id != task_id.rpartition(":")[2]:  # gymnasium adds the latest version
        raise InvalidInput(f"task {task_id!r} has no version, such as {spec.id}")
    if not isinstance(observations, Box) or len(observations.shape) != 1:
        raise InvalidInput(
            f"{task_id} has observations {observations}: allowed is a Box of one dimension; "
            "gymnasium.wrappers.FlattenObservation converts other spaces"
        )
    if not isinstance(actions, Discrete):
        raise InvalidInput(f"{task_id} has actions {actions}: allowed is Discrete")
    return spec, observations.shape[0], int(actions.n)
