"""`bilevel show`: an SE next to episodes on the real task that follow its rewards."""

from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bilevel.kernels.synthetic_env import DONE
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.torch_module import SEModule
from cluster.pictures import GREY

Floats = NDArray[np.float32]

#: Points of the grid in each direction, its half-width in standard deviations, points per arrow.
GRID, WIDTH, EVERY = 61, 2.5, 5

#: Values that cover one continuous action dimension.
VALUES = 21

#: Number of episodes on the real task.
EPISODES = 10


@dataclass(frozen=True)
class Transitions:
    """N steps of an SE."""

    states: Floats  # (N, S)
    next_states: Floats  # (N, S)
    rewards: Floats  # (N,)
    ends: NDArray[np.bool_]  # (N,)


@dataclass(frozen=True)
class Episode:
    """An episode on the real task."""

    states: Floats  # (T + 1, S)
    actions: NDArray[np.int64]  # (T,) indices of `candidate_actions`
    total: float  # return


@dataclass(frozen=True)
class Portrait:
    """An SE over two observations of its task, and episodes on the task."""

    labels: dict[str, float]  # of actions, with their positions in the range of colours
    positions: Floats  # (n,) of all candidate actions
    names: tuple[str, str]  # of the two observations
    indices: tuple[int, int]  # of the two observations
    axes: tuple[Floats, Floats]  # (GRID,) their values
    answers: Transitions  # of the SE, on the grid, action by action; others have their means
    episodes: list[Episode]  # with the actions that the SE rewards most

    @classmethod
    def of(cls, se: StoredSE) -> "Portrait":
        """Scale the grid by observations under random actions. Raises InvalidInput if gymnasium
        does not know the task."""
        task = se.task()
        scale = task.observation_scale(derive(0, Purpose.OBSERVATIONS))
        names, (i, j) = task.labels.observations, task.labels.axes
        steps = np.linspace(-WIDTH, WIDTH, GRID)
        across, up = (
            (scale.mean[k] + scale.deviation[k] * steps).astype(np.float32) for k in (i, j)
        )
        states = np.tile(scale.mean, (GRID * GRID, 1))
        states[:, i], states[:, j] = (axis.ravel() for axis in np.meshgrid(across, up))
        candidates = candidate_actions(se)
        if task.continuous:
            name = task.labels.actions[0]
            labels = {f"{name} {value:+g}": (value + 1) / 2 for value in (-1, -0.5, 0, 0.5, 1)}
            positions = (candidates[:, 0] + 1) / 2
        else:
            positions = candidates / max(len(candidates) - 1, 1)
            labels = dict(zip(task.labels.actions, positions.tolist(), strict=True))
        return cls(
            labels,
            positions,
            (names[i], names[j]),
            (i, j),
            (across, up),
            answers(se, states),
            real_episodes(se),
        )

    @property
    def sentence(self) -> str:
        """Returns of the episodes in words."""
        returns = [episode.total for episode in self.episodes]
        return (
            f"taking the action that the SE rewards most earns {np.mean(returns):.1f} on the real "
            f"task ({min(returns):.1f} to {max(returns):.1f} in {EPISODES} episodes)"
        )


def candidate_actions(se: StoredSE) -> NDArray[Any]:
    """Return all actions (n,) of the SE, or actions (n, A) that cover a continuous range."""
    arch = se.architecture
    if not arch.continuous:
        return np.arange(arch.action_size)
    if arch.action_size == 1:
        return np.linspace(-1, 1, VALUES, dtype=np.float32)[:, None]
    drawn = np.random.default_rng(0).uniform(-1, 1, (VALUES**2, arch.action_size))
    return drawn.astype(np.float32)


def answers(se: StoredSE, states: Floats) -> Transitions:
    """Return the SE's transitions from states (n, S), action by action."""
    actions = candidate_actions(se)
    repeated = np.tile(states, (len(actions), 1))
    outputs = SEModule(se)(
        torch.from_numpy(repeated), torch.from_numpy(np.repeat(actions, len(states), axis=0))
    )
    following, rewards, dones = (output.numpy() for output in outputs)
    return Transitions(repeated, following, rewards, dones > DONE)


def real_episodes(se: StoredSE) -> list[Episode]:
    """Run episodes on the real task with the actions that the SE rewards most."""
    task, episodes, candidates = se.task(), [], candidate_actions(se)
    with closing(task.real_env()) as env:
        for seed in range(EPISODES):
            states, total, over = [env.reset(seed)], 0.0, False
            actions: list[int] = []
            while not over and len(actions) < task.step_limit:
                actions.append(int(answers(se, states[-1][None]).rewards.argmax()))
                state, reward, terminated, truncated = env.step(candidates[actions[-1]])
                states.append(state)
                total, over = total + reward, terminated or truncated
            episodes.append(Episode(np.stack(states), np.array(actions), total))
    return episodes


def picture(portrait: Portrait, title: str) -> Figure:
    """Draw the SE, and the episodes on the real task, over two observations."""
    figure = Figure(figsize=(10, 5), layout="constrained")
    figure.suptitle(f"{title}; other observations have their means")
    colours = [to_hex(colour) for colour in colormaps["viridis"](0.9 * portrait.positions)]
    on_se, on_task = figure.subplots(1, 2, sharex=True, sharey=True)
    _draw_se(on_se, portrait, colours)
    for episode in portrait.episodes:
        path = episode.states[:, portrait.indices]
        on_task.plot(*path.T, color=GREY, lw=0.6, alpha=0.6)
        on_task.scatter(*path[:-1].T, c=np.array(colours)[episode.actions], s=6, zorder=3)
    on_task.set_title("real task: episodes by the SE's rewards")
    on_se.set(xlim=portrait.axes[0][[0, -1]], ylim=portrait.axes[1][[0, -1]])
    on_se.set_ylabel(portrait.names[1])
    for axes in (on_se, on_task):
        axes.set_xlabel(portrait.names[0])
    handles = [
        Patch(color=colormaps["viridis"](0.9 * position), label=label)
        for label, position in portrait.labels.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return figure


def _draw_se(axes: Axes, portrait: Portrait, colours: list[str]) -> None:
    """Colour the action of the highest reward, draw arrows to the next states after this action,
    and hatch where it ends episodes."""
    found = portrait.answers
    best = found.rewards.reshape(-1, GRID * GRID).argmax(axis=0)
    rows = best * GRID * GRID + np.arange(GRID * GRID)
    pale = 1 - 0.4 * (1 - np.array([to_rgb(colour) for colour in colours]))
    axes.pcolormesh(*portrait.axes, pale[best].reshape(GRID, GRID, 3), rasterized=True)
    coarse = rows.reshape(GRID, GRID)[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY].ravel()
    start = found.states[coarse][:, portrait.indices]
    moves = found.next_states[coarse][:, portrait.indices] - start
    # The longest arrow is as long as the distance between two arrows.
    distance = [axis[EVERY] - axis[0] for axis in portrait.axes]
    moves /= max(float(np.linalg.norm(moves / distance, axis=1).max()), 1e-9)
    axes.quiver(*start.T, *moves.T, angles="xy", scale_units="xy", scale=1, width=0.003)
    ends = found.ends[rows].reshape(GRID, GRID)
    if ends.any():
        axes.contourf(*portrait.axes, ends, levels=[0.5, np.inf], colors="none", hatches=["///"])
    axes.set_title("SE: rewarded action and next state; hatched: end")
