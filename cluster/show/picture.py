"""The picture of an SE and of the real task."""

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cluster.pictures import BLUE, GREY, ORANGE
from cluster.show.portrait import GRID, Episode, Portrait, Transitions

#: Colours of actions, which also differ in grey.
_COLOURS = (BLUE, ORANGE, "#1d3b2a", "#b04a8b", "#f0d060")
#: Marks of an episode's first state, and of the last state before an end.
_START: dict[str, Any] = {"marker": "o", "ms": 5.5, "mfc": "none", "mec": "black"}
_END: dict[str, Any] = {"marker": "x", "ms": 4.5, "mec": "black", "ls": "none"}
#: Rows and columns of the grid per arrow.
_EVERY = 5
#: Relative difference below which moves count as equal.
_SAME = 1e-3


def picture(portrait: Portrait, title: str) -> Figure:
    """Draw the SE above the real task over two observations: rewards, transitions and ends, and
    episodes with the actions that the SE rewards most."""
    figure = Figure(figsize=(12.5, 8), layout="constrained")
    figure.suptitle(f"{title}; other observations have their means")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    (rewards, transitions, synthetic), (real_rewards, real_transitions, real) = panels
    _rewards(rewards, portrait)
    _se_transitions(transitions, portrait)
    _episodes(synthetic, portrait, portrait.synthetic, "episodes on the SE")
    _real_rewards(real_rewards, portrait)
    _real_transitions(real_transitions, portrait)
    mean = np.mean([episode.total for episode in portrait.real])
    _episodes(
        real, portrait, portrait.real, f"real episodes by the SE's rewards: return {mean:.1f}"
    )
    rewards.set(xlim=portrait.axes[0][[0, -1]], ylim=portrait.axes[1][[0, -1]])
    for axes in panels[1]:
        axes.set_xlabel(portrait.names[0])
    for axes in panels[:, 0]:
        axes.set_ylabel(portrait.names[1])
    colours = colours_of(len(portrait.actions))
    handles: list[Artist] = [
        *(Patch(color=c, label=n) for c, n in zip(colours, portrait.actions, strict=True)),
        Patch(color=GREY, label="all actions"),
        Line2D([], [], **_START, ls="none", label="an episode's first state"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return figure


def colours_of(actions: int) -> list[str]:
    """Return a colour for each action."""
    if actions <= len(_COLOURS):
        return list(_COLOURS[:actions])
    return [to_hex(colour) for colour in colormaps["turbo"](np.linspace(0, 1, actions))]


def _rewards(axes: Axes, portrait: Portrait) -> None:
    """Colour the action of the highest reward, paler for smaller differences."""
    rewards = portrait.transitions.rewards.reshape(-1, GRID, GRID)
    ordered = np.sort(rewards, axis=0)
    margin = ordered[-1] - ordered[-2] if len(ordered) > 1 else np.ones_like(ordered[0])
    strength = 0.15 + 0.85 * margin / max(float(margin.max()), 1e-9)
    colours = np.array([to_rgb(colour) for colour in colours_of(len(rewards))])
    image = 1 - strength[..., None] * (1 - colours[rewards.argmax(axis=0)])
    across, up = portrait.axes
    extent = (float(across[0]), float(across[-1]), float(up[0]), float(up[-1]))
    axes.imshow(image, origin="lower", extent=extent, aspect="auto")
    axes.set_title("the action that the SE rewards most (pale: by little)", fontsize="medium")


def _real_rewards(axes: Axes, portrait: Portrait) -> None:
    """Draw the rewards of random steps, or state the only reward."""
    real = portrait.real_transitions
    title = "rewards of the real task"
    if np.ptp(real.rewards) == 0:
        title += f": always {real.rewards[0]:g}"
    else:
        across, up = real.states[:, portrait.indices].T
        points = axes.scatter(across, up, c=real.rewards, s=9)
        axes.figure.colorbar(points, ax=axes, shrink=0.8, label="reward")
    axes.set_title(title, fontsize="medium")


def _se_transitions(axes: Axes, portrait: Portrait) -> None:
    """Draw arrows to the SE's next states on a coarse grid, and hatch where episodes end."""
    coarse = portrait.states.reshape(GRID, GRID, -1)[_EVERY // 2 :: _EVERY, _EVERY // 2 :: _EVERY]
    steps = portrait.answers(coarse.reshape(-1, coarse.shape[-1]))
    moves = (steps.next_states - steps.states)[:, portrait.indices]
    spread = np.ptp(moves.reshape(len(portrait.actions), -1, 2), axis=0).max()
    equal = spread < _SAME * np.abs(moves).max()
    _arrows(axes, portrait, steps, [GREY] if equal else colours_of(len(portrait.actions)))
    ends = portrait.transitions.ends.reshape(-1, GRID, GRID).any(axis=0)
    if ends.any():
        axes.contourf(*portrait.axes, ends, levels=[0.5, np.inf], colors="none", hatches=["///"])
    if ends.any() and not ends.all():
        axes.contour(*portrait.axes, ends, levels=[0.5], colors="black", linewidths=1)
    axes.set_title("transitions of the SE; hatched: episodes end", fontsize="medium")


def _real_transitions(axes: Axes, portrait: Portrait) -> None:
    """Draw arrows to the next states of random steps, and mark where episodes end."""
    steps = portrait.real_transitions
    _arrows(axes, portrait, steps, colours_of(len(portrait.actions)))
    axes.plot(*steps.states[steps.ends][:, portrait.indices].T, **_END)
    title = "random steps on the real task; crosses: ends"
    axes.set_title(title, fontsize="medium")


def _arrows(axes: Axes, portrait: Portrait, steps: Transitions, colours: list[str]) -> None:
    """Draw an arrow per transition in the colour of its action. The longest ones have the length
    of a step of the coarse grid."""
    steps_of_grid = np.array([axis[_EVERY] - axis[0] for axis in portrait.axes])
    moves = (steps.next_states - steps.states)[:, portrait.indices] / steps_of_grid
    longest = max(float(np.percentile(np.linalg.norm(moves, axis=1), 98)), 1e-9)
    for action, colour in enumerate(colours):
        rows = steps.actions == action
        axes.quiver(
            *steps.states[rows][:, portrait.indices].T,
            *(moves[rows] * steps_of_grid / longest).T,
            color=colour,
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.003,
        )


def _episodes(axes: Axes, portrait: Portrait, episodes: list[Episode], title: str) -> None:
    """Draw the paths of episodes, with each state in the colour of its action."""
    colours = np.array(colours_of(len(portrait.actions)))
    for episode in episodes:
        path = episode.states[:, portrait.indices]
        axes.plot(*path.T, color=GREY, lw=0.6, alpha=0.6)
        axes.scatter(path[:-1, 0], path[:-1, 1], c=colours[episode.actions], s=6, zorder=3)
        axes.plot(*path[0], **_START, zorder=4)
    axes.set_title(title, fontsize="medium")
