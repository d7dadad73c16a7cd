"""Environments that agents train and are tested on: SEs and real tasks."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.training import TrainingEnvironment
from bilevel.kernels import synthetic_env
from bilevel.kernels.environment import Environment, reset, step
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task, checked_action

#: Placeholder where the kernel takes an SE but does not read it.
_SMALLEST = Architecture(1, 1, 1, 1, "tanh", 1)
_NO_SE = SE(_SMALLEST, np.zeros(_SMALLEST.parameter_count, np.float32))


def compiled_environment(task: Task, se: SE | None, episodes: int, seed: int) -> Environment:
    """The SE, or (None) the compiled real task; `seed` draws the initial states of `episodes`
    episodes. Raises InvalidInput for an SE of a task with other sizes."""
    if se is not None:
        se.architecture.check_fits(task)
    kernel = (se or _NO_SE).kernel
    physics = task.initial_physics(np.random.default_rng(seed), episodes)
    return Environment(
        synthetic=se is not None,
        se=kernel,
        dynamics=task.dynamics,
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
        with closing(GymnasiumEnvironment(task, seed)) as env:
            yield env
    else:
        yield KernelEnvironment(compiled_environment(task, se, episodes, seed), task.n_actions)


class KernelEnvironment:
    """An SE or a compiled real task (see `TrainingEnvironment`). It returns copies of its state, so
    that agents cannot change it."""

    def __init__(self, env: Environment, n_actions: int) -> None:
        self.step_limit = env.step_limit
        self._env, self._n_actions = env, n_actions
        self._state = np.zeros(env.state_size, np.float32)

    def reset(self, episode: int) -> NDArray[np.float32]:
        """See `TrainingEnvironment`."""
        reset(self._env, episode, self._state)
        return self._state.copy()

    def step(self, action: int) -> tuple[NDArray[np.float32], float, float, bool]:
        """See `TrainingEnvironment`."""
        action, next_state = checked_action(action, self._n_actions), np.empty_like(self._state)
        reward, done, over = step(self._env, self._state, action, next_state)
        self._state = next_state
        return next_state.copy(), float(reward), float(done), bool(over)


class GymnasiumEnvironment:
    """A real task in gymnasium (see `TrainingEnvironment`). Each episode has its own seed, so that
    all agents start it in the same state."""

    def __init__(self, task: Task, seed: int) -> None:
        self.step_limit = task.step_limit
        self._env: Any = task.make()
        self._seed, self._n_actions = seed, task.n_actions

    def close(self) -> None:
        """Close the simulator, which may hold processes or sockets."""
        self._env.close()

    def reset(self, episode: int) -> NDArray[np.float32]:
        """See `TrainingEnvironment`."""
        (word,) = np.random.SeedSequence([self._seed, episode]).generate_state(1)
        state, _ = self._env.reset(seed=int(word) % 2**31)
        return np.asarray(state, np.float32)

    def step(self, action: int) -> tuple[NDArray[np.float32], float, float, bool]:
        """See `TrainingEnvironment`."""
        first = self._env.action_space.start
        taken = first + checked_action(action, self._n_actions)
        state, reward, terminated, truncated, _ = self._env.step(taken)
        over = bool(terminated or truncated)
        return np.asarray(state, np.float32), float(reward), float(terminated), over
