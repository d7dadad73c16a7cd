"""The numbers behind a picture of an SE, beside those of the real task: fields over two of the
observations, and episodes."""

from contextlib import closing
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.kernels import dynamics
from bilevel.kernels.synthetic_env import DONE
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import Task
from bilevel.tasks.names import action_names, observation_names, picture_axes
from bilevel.tasks.task import RealEnv
from bilevel.tasks.transitions import Transitions

Floats = NDArray[np.float32]

#: Points of the grid in each direction; half-width of the fields, in standard deviations of the
#: observations; episodes.
GRID, WIDTH, EPISODES = 61, 2.5, 10
#: Steps of random actions that stand for the dynamics of a task which is not compiled.
RANDOM_STEPS = 600


@dataclass(frozen=True)
class Plane:
    """Two observations of a task, the others being held at their means."""

    indices: tuple[int, int]
    names: tuple[str, str]
    mean: Floats  # (S,)
    deviation: Floats  # (S,)

    @classmethod
    def of(cls, task: Task) -> "Plane":
        """The plane of a task, scaled by its observations under random actions."""
        scale = task.observation_scale(derive(0, Purpose.OBSERVATIONS))
        names = observation_names(task.id, task.state_size)
        i, j = picture_axes(task.id, task.state_size)
        return cls((i, j), (names[i], names[j]), scale.mean, scale.deviation)

    @cached_property
    def axes(self) -> tuple[Floats, Floats]:
        """The values (GRID,) of both observations."""
        steps = np.linspace(-WIDTH, WIDTH, GRID)
        i, j = self.indices
        across, up = (self.mean[k] + self.deviation[k] * steps for k in (i, j))
        return across.astype(np.float32), up.astype(np.float32)

    @property
    def states(self) -> Floats:
        """The observations (GRID * GRID, S), row by row."""
        states = np.tile(self.mean, (GRID * GRID, 1))
        across, up = np.meshgrid(*self.axes)
        states[:, self.indices[0]], states[:, self.indices[1]] = across.ravel(), up.ravel()
        return states


@dataclass(frozen=True)
class Episode:
    """One episode: observations (T, S), actions (T,), and the return."""

    states: Floats
    actions: NDArray[np.int64]
    total: float


@dataclass(frozen=True)
class TransitionField:
    """What n states lead to: `following` (A, n, S), `rewards` (A, n) and `ends` (A, n), by action;
    NaN, and no end, where an action was not tried."""

    states: Floats  # (n, S)
    following: Floats
    rewards: Floats
    ends: NDArray[np.bool_]

    @property
    def whole(self) -> bool:
        """Whether every action was tried in every state."""
        return not np.isnan(self.rewards).any()

    def grid(self, every: int) -> "TransitionField":
        """Of states on a grid (`Plane.states`), those of every so manieth row and column."""
        chosen = np.zeros((GRID, GRID), bool)
        chosen[every // 2 :: every, every // 2 :: every] = True
        kept = chosen.ravel()
        return TransitionField(
            self.states[kept], self.following[:, kept], self.rewards[:, kept], self.ends[:, kept]
        )


@dataclass(frozen=True)
class Portrait:
    """An SE in numbers."""

    se: StoredSE
    plane: Plane

    @classmethod
    def of(cls, se: StoredSE) -> "Portrait":
        """The portrait of an SE. Raises InvalidInput if gymnasium does not know its task, or for
        parameters that are not finite."""
        if not np.isfinite(se.se.psi).all():
            raise InvalidInput("cannot draw the SE: some of its parameters are not finite")
        return cls(se, Plane.of(se.task()))

    @cached_property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions."""
        return action_names(self.se.task_id, self.se.architecture.n_actions)

    @cached_property
    def _module(self) -> SEModule:
        return SEModule(self.se)

    def answers(self, states: Floats) -> tuple[Floats, Floats, Floats]:
        """Next states (A, n, S), rewards (A, n) and raw done (A, n) of states (n, S)."""
        rows = torch.from_numpy(states)
        found = [
            self._module(rows, torch.full((len(states),), action))
            for action in range(self.se.architecture.n_actions)
        ]
        following, rewards, dones = (
            np.stack([o.numpy() for o in part]) for part in zip(*found, strict=True)
        )
        return following, rewards, dones

    @cached_property
    def fields(self) -> tuple[Floats, Floats, Floats]:
        """The fields over the plane."""
        return self.answers(self.plane.states)

    @cached_property
    def transitions(self) -> TransitionField:
        """The SE's transitions over the plane."""
        following, rewards, dones = self.fields
        return TransitionField(self.plane.states, following, rewards, dones > DONE)

    @cached_property
    def real_transitions(self) -> TransitionField:
        """The real task's transitions: over the plane if it is compiled, else those of
        RANDOM_STEPS random actions. They are drawn, and nothing learns from them."""
        task = self.se.task()
        return _simulated(task, self.plane.states) if task.compiled else _met(task)

    def rewarded(self, state: Floats) -> int:
        """The action of the highest reward in a state (S,)."""
        return int(self.answers(state[None])[1][:, 0].argmax())

    @cached_property
    def synthetic(self) -> list[Episode]:
        """Episodes on the SE, taking the action of the highest reward."""
        rng = np.random.default_rng(derive(0, Purpose.EVALUATION))
        task, found = self.se.task(), []
        for physics in task.initial_physics(rng, EPISODES):
            state, states, actions, total = task.observe(physics), [], [], 0.0
            for _ in range(self.se.architecture.step_limit):
                following, rewards, dones = self.answers(state[None])
                action = int(rewards[:, 0].argmax())
                states.append(state)
                actions.append(action)
                total += float(rewards[action, 0])
                state = following[action, 0]
                if dones[action, 0] > DONE:
                    break
            found.append(Episode(np.stack([*states, state]), np.array(actions), total))
        return found

    @cached_property
    def real(self) -> list[Episode]:
        """Episodes on the real task, taking the action that the SE rewards most."""
        with closing(self.se.task().make()) as env:
            return [self._real_episode(env, number) for number in range(EPISODES)]

    def _real_episode(self, env: RealEnv, seed: int) -> Episode:
        start = int(env.action_space.start)  # type: ignore[attr-defined]
        state, _ = env.reset(seed=seed)
        states, actions, total, over = [state], [], 0.0, False
        while not over:
            actions.append(self.rewarded(np.asarray(state, np.float32)))
            state, reward, terminated, truncated, _ = env.step(np.int64(start + actions[-1]))
            states.append(state)
            total += float(reward)
            over = terminated or truncated
        return Episode(np.array(states, np.float32), np.array(actions), total)

    @property
    def sentences(self) -> list[str]:
        """The picture's content in sentences."""
        lengths = [len(episode.actions) for episode in self.synthetic]
        taken = np.concatenate([episode.actions for episode in self.synthetic])
        shares = ", ".join(
            f"{name} in {np.mean(taken == number):.0%}" for number, name in enumerate(self.actions)
        )
        returns = [episode.total for episode in self.real]
        return [
            f"episodes on the SE last {np.mean(lengths):.0f} steps "
            f"({min(lengths)} to {max(lengths)})",
            f"of the states that they visit, its rewards prefer {shares}",
            f"taking the action that it rewards most earns {np.mean(returns):.1f} on "
            f"{self.se.task_id} ({min(returns):.1f} to {max(returns):.1f} in {EPISODES} episodes)",
        ]


def _simulated(task: Task, states: Floats) -> TransitionField:
    """What a compiled task makes of every action in these states (n, S)."""
    shape = task.n_actions, len(states)
    found = TransitionField(
        states,
        np.empty((*shape, task.state_size), np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, bool),
    )
    for action in range(task.n_actions):
        for row, state in enumerate(states):
            physics = task.physics(state)
            reward, over = dynamics.step(task.dynamics, physics, action)
            found.following[action, row] = task.observe(physics)
            found.rewards[action, row], found.ends[action, row] = reward, over
    return found


def _met(task: Task) -> TransitionField:
    """What random actions meet on the task; each state has one action that was tried."""
    met = Transitions.recorded(task, RANDOM_STEPS, derive(0, Purpose.EVALUATION))
    tried = met.actions == np.arange(task.n_actions)[:, None]  # (A, n)
    return TransitionField(
        met.states,
        np.where(tried[..., None], met.next_states, np.float32(np.nan)),
        np.where(tried, met.rewards, np.float32(np.nan)),
        tried & (met.ends > 0),
    )
