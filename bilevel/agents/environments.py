"""Environments that agents train and are tested on: SEs and real tasks."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.training import TrainingEnvironment
from bilevel.kernels import dynamics, synthetic_env
from bilevel.kernels.environment import Environment, reset, step
from bilevel.spaces import Action, checked_action
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import RealEnv, Task

#: Maximum number of an SE's own initial states per training, whose episodes cycle through them.
INITIAL_STATES = 10_000

#: Placeholder where the kernel takes an SE but does not read it.
_SMALLEST = Architecture(1, 1, 1, 1, "tanh", 1)
_NO_SE = SE(_SMALLEST, np.zeros(_SMALLEST.parameter_count, np.float32))


def compiled_environment(task: Task, se: SE | None, episodes: int, seed: int) -> Environment:
    """The SE, or (None) the compiled real task; `seed` draws the initial states of `episodes`
    episodes. Raises InvalidInput for an SE of a task with other sizes."""
    if se is not None:
        se.architecture.check_fits(task)
    kernel, code, rng = (se or _NO_SE).kernel, task.dynamics, np.random.default_rng(seed)
    if se is not None and se.architecture.own_initial_states:
        physics = se.initial_states(rng, min(episodes, INITIAL_STATES)).astype(np.float64)
        code = dynamics.OBSERVED
    else:
        physics = task.initial_physics(rng, episodes)
    return Environment(
        synthetic=se is not None,
        se=kernel,
        dynamics=code,
        state_size=task.state_size,
        step_limit=task.step_limit if se is None else se.architecture.step_limit,
        solved_reward=task.solved_reward,
        initial_physics=physics,
        physics=np.zeros(physics.shape[1]),
        work=synthetic_env.work_space(kernel),
    )


@contextmanager
def environment_in_python(
    task: Task, se: SE | None, episodes: int, seed: int
) -> Iterator[TrainingEnvironment]:
    """Context with the environment, compiled or in gymnasium, for agents in Python."""
    if se is None and not task.compiled:
        with task.shared_env() as real:
            yield GymnasiumEnvironment(task, real, seed)
    else:
        env = compiled_environment(task, se, episodes, seed)
        yield KernelEnvironment(env, task.action_size, task.continuous)


class KernelEnvironment:
    """An SE or a compiled real task (see `TrainingEnvironment`). It returns copies of its state, so
    that agents cannot change it."""

    def __init__(self, env: Environment, action_size: int, continuous: bool = False) -> None:
        self.step_limit = env.step_limit
        self._env, self._actions = env, (action_size, continuous)
        self._state = np.zeros(env.state_size, np.float32)

    def reset(self, episode: int) -> NDArray[np.float32]:
        """See `TrainingEnvironment`."""
        reset(self._env, episode, self._state)
        return self._state.copy()

    def step(self, action: Action) -> tuple[NDArray[np.float32], float, float, bool]:
        """See `TrainingEnvironment`."""
        action, next_state = checked_action(action, *self._actions), np.empty_like(self._state)
        reward, done, over = step(self._env, self._state, action, next_state)
        self._state = next_state
        return next_state.copy(), float(reward), float(done), bool(over)


class GymnasiumEnvironment:
    """A real task in gymnasium (see `TrainingEnvironment`). Each episode has its own seed, so that
    all agents start it in the same state."""

    def __init__(self, task: Task, env: RealEnv, seed: int) -> None:
        self.step_limit = task.step_limit
        self._env, self._seed = env, seed

    def reset(self, episode: int) -> NDArray[np.float32]:
        """See `TrainingEnvironment`."""
        (word,) = np.random.SeedSequence([self._seed, episode]).generate_state(1)
        return self._env.reset(int(word) % 2**31)

    def step(self, action: Action) -> tuple[NDArray[np.float32], float, float, bool]:
        """See `TrainingEnvironment`."""
        state, reward, terminated, truncated = self._env.step(action)
        return state, reward, float(terminated), terminated or truncated
