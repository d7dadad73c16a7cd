"""The numbers behind a picture of an SE and of the real task: transitions and episodes."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from bilevel.kernels.synthetic_env import DONE
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.torch_module import SEModule

Floats = NDArray[np.float32]

#: Points of the grid in each direction, and its half-width in standard deviations.
GRID, WIDTH = 61, 2.5
#: Number of episodes, and of random steps on the real task.
EPISODES, RANDOM_STEPS = 10, 600
#: Maximum repetitions of a random action: actions that change in every step hardly move tasks with
#: momentum (Acrobot).
REPEATS = 4

#: Returns action, next state (S,), reward and end after a state (S,).
Step = Callable[[Floats], tuple[int, Floats, float, bool]]


@dataclass(frozen=True)
class Transitions:
    """N steps of an SE or of its real task."""

    states: Floats  # (N, S)
    actions: NDArray[np.int64]  # (N,)
    next_states: Floats  # (N, S)
    rewards: Floats  # (N,)
    ends: NDArray[np.bool_]  # (N,)


@dataclass(frozen=True)
class Episode:
    """One episode."""

    states: Floats  # (T + 1, S)
    actions: NDArray[np.int64]  # (T,)
    total: float  # return

    @classmethod
    def of(cls, state: Floats, step: Step, limit: int) -> "Episode":
        """Run an episode of at most `limit` steps from an initial state (S,)."""
        states, total, over = [state], 0.0, False
        actions: list[int] = []
        while not over and len(actions) < limit:
            action, state, reward, over = step(state)
            states.append(state)
            actions.append(action)
            total += reward
        return cls(np.stack(states), np.array(actions), total)


@dataclass(frozen=True)
class Portrait:
    """An SE in numbers, over two observations of its task."""

    se: StoredSE
    indices: tuple[int, int]  # of the two observations
    axes: tuple[Floats, Floats]  # (GRID,) their values
    states: Floats  # (GRID * GRID, S) row by row; other observations have their means

    @classmethod
    def of(cls, se: StoredSE) -> "Portrait":
        """Scale the grid by observations under random actions. Raises InvalidInput if gymnasium
        does not know the task."""
        task = se.task()
        scale = task.observation_scale(derive(0, Purpose.OBSERVATIONS))
        i, j = task.labels.axes
        steps = np.linspace(-WIDTH, WIDTH, GRID)
        across, up = (
            (scale.mean[k] + scale.deviation[k] * steps).astype(np.float32) for k in (i, j)
        )
        states = np.tile(scale.mean, (GRID * GRID, 1))
        states[:, i], states[:, j] = (axis.ravel() for axis in np.meshgrid(across, up))
        return cls(se, (i, j), (across, up), states)

    @cached_property
    def names(self) -> tuple[str, str]:
        """Names of the two observations."""
        names = self.se.task().labels.observations
        return names[self.indices[0]], names[self.indices[1]]

    @cached_property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions."""
        return self.se.task().labels.actions

    @cached_property
    def _module(self) -> SEModule:
        return SEModule(self.se)

    def answers(self, states: Floats) -> Transitions:
        """Return the SE's transitions from states (n, S), action by action."""
        actions = np.repeat(np.arange(len(self.actions)), len(states))
        repeated = np.tile(states, (len(self.actions), 1))
        outputs = self._module(torch.from_numpy(repeated), torch.from_numpy(actions))
        following, rewards, dones = (output.numpy() for output in outputs)
        return Transitions(repeated, actions, following, rewards, dones > DONE)

    @cached_property
    def transitions(self) -> Transitions:
        """The SE's transitions over the grid."""
        return self.answers(self.states)

    @cached_property
    def real_transitions(self) -> Transitions:
        """Random steps on the real task. They are drawn, and nothing learns from them."""
        task, rng = self.se.task(), np.random.default_rng(derive(0, Purpose.EVALUATION))
        rows: list[tuple[Any, ...]] = []
        action = left = 0
        with closing(task.make()) as env:
            first = env.action_space.start  # type: ignore[attr-defined]
            while len(rows) < RANDOM_STEPS:
                state, ended = env.reset(seed=int(rng.integers(2**31)))[0], False
                while not ended and len(rows) < RANDOM_STEPS:
                    if not left:
                        action = int(rng.integers(task.n_actions))
                        left = int(rng.integers(1, REPEATS + 1))
                    left -= 1
                    following, reward, end, truncated, _ = env.step(first + action)
                    rows.append((state, action, following, reward, end))
                    state, ended = following, end or truncated
        return Transitions(*map(np.array, zip(*rows, strict=True)))

    def _rewarded(self, state: Floats) -> tuple[int, Floats, float, bool]:
        """Take the action with the highest reward on the SE."""
        answers = self.answers(state[None])
        action = int(answers.rewards.argmax())
        reward, end = float(answers.rewards[action]), bool(answers.ends[action])
        return action, answers.next_states[action], reward, end

    @cached_property
    def synthetic(self) -> list[Episode]:
        """Episodes on the SE with the actions that it rewards most."""
        rng, task = np.random.default_rng(derive(0, Purpose.EVALUATION)), self.se.task()
        starts = task.initial_physics(rng, EPISODES)
        limit = self.se.architecture.step_limit
        return [Episode.of(task.observe(start), self._rewarded, limit) for start in starts]

    @cached_property
    def real(self) -> list[Episode]:
        """Episodes on the real task with the actions that the SE rewards most."""
        task = self.se.task()
        with closing(task.make()) as env:
            first = env.action_space.start  # type: ignore[attr-defined]

            def as_state(observation: Any) -> Floats:
                return np.asarray(observation, np.float32)

            def step(state: Floats) -> tuple[int, Floats, float, bool]:
                action = self._rewarded(state)[0]
                following, reward, terminated, truncated, _ = env.step(np.int64(first + action))
                return action, as_state(following), float(reward), terminated or truncated

            return [
                Episode.of(as_state(env.reset(seed=seed)[0]), step, task.step_limit)
                for seed in range(EPISODES)
            ]

    @property
    def sentences(self) -> list[str]:
        """Description of the picture."""
        lengths = [len(episode.actions) for episode in self.synthetic]
        taken = np.concatenate([episode.actions for episode in self.synthetic])
        shares = ", ".join(
            f"{name} in {np.mean(taken == number):.0%}" for number, name in enumerate(self.actions)
        )
        returns = [episode.total for episode in self.real]
        return [
            f"episodes on the SE last {np.mean(lengths):.0f} steps "
            f"({min(lengths)} to {max(lengths)})",
            f"in the states of these episodes, its rewards prefer {shares}",
            f"taking the action that it rewards most earns {np.mean(returns):.1f} on "
            f"{self.se.task_id} ({min(returns):.1f} to {max(returns):.1f} in {EPISODES} episodes)",
        ]
