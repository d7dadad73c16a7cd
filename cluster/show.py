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
from bilevel.synthetic_env import Architecture, StoredSE
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks.compiled import Labels
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
class SEPlot:
    """An SE over two observations of its task, and episodes on the task."""

    labels: Labels
    positions: NDArray[np.float64]  # (n,) of all candidate actions, in the range of colours
    axes: tuple[Floats, Floats]  # (GRID,) values of the two observations
    answers: Transitions  # of the SE, on the grid, action by action; others have their means
    episodes: list[Episode]  # with the actions that the SE rewards most

    @classmethod
    def of(cls, se: StoredSE) -> "SEPlot":
        """Scale the grid by observations under random actions. Raises InvalidInput if gymnasium
        does not know the task."""
        task = se.task()
        scale = task.observation_scale(derive(0, Purpose.OBSERVATIONS))
        steps, (i, j) = np.linspace(-WIDTH, WIDTH, GRID), task.labels.axes
        across, up = (
            (scale.mean[k] + scale.deviation[k] * steps).astype(np.float32) for k in (i, j)
        )
        states = np.tile(scale.mean, (GRID * GRID, 1))
        states[:, i], states[:, j] = (axis.ravel() for axis in np.meshgrid(across, up))
        actions = candidate_actions(se.architecture)
        if task.continuous:
            positions = (actions[:, 0] + 1) / 2
        else:
            positions = actions / max(len(actions) - 1, 1)
        return cls(task.labels, positions, (across, up), answers(se, states), real_episodes(se))


def candidate_actions(arch: Architecture) -> NDArray[Any]:
    """Return all actions (n,) of an SE, or actions (n, A) that cover a continuous range."""
    if not arch.continuous:
        return np.arange(arch.action_size)
    if arch.action_size == 1:
        return np.linspace(-1, 1, VALUES, dtype=np.float32)[:, None]
    drawn = np.random.default_rng(0).uniform(-1, 1, (VALUES**2, arch.action_size))
    return drawn.astype(np.float32)


def answers(se: StoredSE, states: Floats) -> Transitions:
    """Return the SE's transitions from states (n, S), action by action."""
    actions = candidate_actions(se.architecture)
    repeated = np.tile(states, (len(actions), 1))
    outputs = SEModule(se)(
        torch.from_numpy(repeated), torch.from_numpy(np.repeat(actions, len(states), axis=0))
    )
    following, rewards, dones = (output.numpy() for output in outputs)
    return Transitions(repeated, following, rewards, dones > DONE)


def real_episodes(se: StoredSE) -> list[Episode]:
    """Run episodes on the real task with the actions that the SE rewards most."""
    task, episodes, candidates = se.task(), [], candidate_actions(se.architecture)
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


def action_colours(positions: NDArray[np.float64]) -> list[str]:
    """Return the colours of actions at these positions, 0 to 1."""
    return [to_hex(colour) for colour in colormaps["viridis"](0.9 * positions)]


def picture(plot: SEPlot, title: str) -> Figure:
    """Draw the SE, and the episodes on the real task, over two observations."""
    figure = Figure(figsize=(10, 5), layout="constrained")
    figure.suptitle(f"{title}; other observations have their means")
    labels, colours = plot.labels, action_colours(plot.positions)
    on_se, on_task = figure.subplots(1, 2, sharex=True, sharey=True)
    _draw_se(on_se, plot, colours)
    for episode in plot.episodes:
        path = episode.states[:, labels.axes]
        on_task.plot(*path.T, color=GREY, lw=0.6, alpha=0.6)
        on_task.scatter(*path[:-1].T, c=np.array(colours)[episode.actions], s=6, zorder=3)
    on_task.set_title("real task: episodes by the SE's rewards")
    on_se.set(xlim=plot.axes[0][[0, -1]], ylim=plot.axes[1][[0, -1]])
    on_se.set_ylabel(labels.observations[labels.axes[1]])
    for axes in (on_se, on_task):
        axes.set_xlabel(labels.observations[labels.axes[0]])
    named = labels.actions
    if len(colours) != len(named):  # the first dimension of continuous actions
        named = tuple(f"{named[0]} {value:+g}" for value in np.linspace(-1, 1, 5))
    patches = zip(action_colours(np.linspace(0, 1, len(named))), named, strict=True)
    handles = [Patch(color=colour, label=label) for colour, label in patches]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return figure


def _draw_se(axes: Axes, plot: SEPlot, colours: list[str]) -> None:
    """Colour the action of the highest reward. Draw arrows to the next states after this action,
    and hatch where it ends episodes, unless all episodes have one step."""
    found = plot.answers
    best = found.rewards.reshape(-1, GRID * GRID).argmax(axis=0)
    rows = best * GRID * GRID + np.arange(GRID * GRID)
    pale = 1 - 0.4 * (1 - np.array([to_rgb(colour) for colour in colours]))
    axes.pcolormesh(*plot.axes, pale[best].reshape(GRID, GRID, 3), rasterized=True)
    ends = found.ends[rows].reshape(GRID, GRID)
    if ends.all():
        axes.set_title("SE: rewarded action; episodes have one step")
        return
    coarse = rows.reshape(GRID, GRID)[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY].ravel()
    start = found.states[coarse][:, plot.labels.axes]
    moves = found.next_states[coarse][:, plot.labels.axes] - start
    # The longest arrow is as long as the distance between two arrows.
    distance = [axis[EVERY] - axis[0] for axis in plot.axes]
    moves /= max(float(np.linalg.norm(moves / distance, axis=1).max()), 1e-9)
    axes.quiver(*start.T, *moves.T, angles="xy", scale_units="xy", scale=1, width=0.003)
    if ends.any():
        axes.contourf(*plot.axes, ends, levels=[0.5, np.inf], colors="none", hatches=["///"])
    axes.set_title("SE: rewarded action and next state; hatched: end")
