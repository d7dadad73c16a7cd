"""The picture of an SE."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from bilevel.synthetic_env.storage import DONE
from cluster.show.portrait import GRID, Episode, Portrait
from cluster.tracking.pictures import BLUE, GREY, ORANGE

#: Colours of actions, told apart also in grey.
_COLOURS = (BLUE, ORANGE, "#1d3b2a", "#b04a8b", "#f0d060")
#: Every so manieth point of the grid has an arrow.
_EVERY = 5


def picture(portrait: Portrait, title: str) -> Figure:
    """Four panels over the same two observations: the action that the SE rewards most, its next
    states and ends, episodes on it, and episodes on the real task by its rewards."""
    figure = Figure(figsize=(9, 8), layout="constrained")
    figure.suptitle(title)
    (rewards, course), (synthetic, real) = figure.subplots(2, 2, sharex=True, sharey=True)
    _rewards(rewards, portrait)
    _course(course, portrait)
    _episodes(synthetic, portrait, portrait.synthetic)
    synthetic.set_title("episodes on the SE", fontsize="medium")
    _episodes(real, portrait, portrait.real)
    mean = np.mean([episode.total for episode in portrait.real])
    real.set_title(
        f"on {portrait.se.task_id}, by the SE's rewards: return {mean:.1f}", fontsize="medium"
    )
    across, up = portrait.plane.names
    for axes in (synthetic, real):
        axes.set_xlabel(across)
    for axes in (rewards, synthetic):
        axes.set_ylabel(up)
    low, high = portrait.plane.axes[0][[0, -1]], portrait.plane.axes[1][[0, -1]]
    rewards.set_xlim(*low)
    rewards.set_ylim(*high)
    names = [Patch(color=_colour(n), label=name) for n, name in enumerate(portrait.actions)]
    figure.legend(handles=names, loc="outside lower center", ncols=len(names), frameon=False)
    return figure


def _colour(action: int) -> str:
    return _COLOURS[action % len(_COLOURS)]


def _extent(portrait: Portrait) -> tuple[float, float, float, float]:
    across, up = portrait.plane.axes
    return float(across[0]), float(across[-1]), float(up[0]), float(up[-1])


def _rewards(axes: Axes, portrait: Portrait) -> None:
    """The action of the highest reward; the paler, the less it matters."""
    rewards = portrait.fields[1].reshape(-1, GRID, GRID)
    ordered = np.sort(rewards, axis=0)
    margin = ordered[-1] - ordered[-2] if len(ordered) > 1 else np.ones_like(ordered[0])
    strength = 0.15 + 0.85 * margin / max(float(margin.max()), 1e-9)
    colours = np.array([to_rgb(_colour(action)) for action in range(len(rewards))])
    shown = 1 - strength[..., None] * (1 - colours[rewards.argmax(axis=0)])
    axes.imshow(shown, origin="lower", extent=_extent(portrait), aspect="auto")
    axes.set_title("the action it rewards most (pale: by little)", fontsize="medium")


def _course(axes: Axes, portrait: Portrait) -> None:
    """Next states, averaged over the actions, and where episodes end."""
    following, _, dones = portrait.fields
    i, j = portrait.plane.indices
    states = portrait.plane.states
    moves = (following.mean(axis=0) - states)[:, [i, j]].reshape(GRID, GRID, 2)
    thin = slice(_EVERY // 2, None, _EVERY)
    across, up = portrait.plane.axes
    axes.quiver(
        *(across[thin], up[thin]),
        *(moves[thin, thin, 0], moves[thin, thin, 1]),
        color=GREY,
        angles="xy",
    )
    ends = dones.max(axis=0).reshape(GRID, GRID)
    if (ends > DONE).any() and (ends <= DONE).any():
        axes.contourf(across, up, ends, levels=[DONE, np.inf], colors="none", hatches=["///"])
        axes.contour(across, up, ends, levels=[DONE], colors="black", linewidths=1)
    axes.set_title("where it goes next; hatched: the episode ends", fontsize="medium")


def _episodes(axes: Axes, portrait: Portrait, episodes: list[Episode]) -> None:
    """Paths of episodes, each state in the colour of the action taken there."""
    i, j = portrait.plane.indices
    for episode in episodes:
        path = episode.states
        axes.plot(path[:, i], path[:, j], color=GREY, lw=0.6, alpha=0.6)
        colours = [_colour(action) for action in episode.actions]
        axes.scatter(path[:-1, i], path[:-1, j], c=colours, s=6, zorder=3)
        axes.scatter(path[0, i], path[0, j], marker="o", s=30, fc="none", ec="black", zorder=4)
