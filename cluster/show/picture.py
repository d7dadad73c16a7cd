"""The picture of an SE."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from cluster.pictures import BLUE, GREY, ORANGE
from cluster.show.portrait import GRID, Episode, Portrait, TransitionField

#: Colours of actions, told apart also in grey.
_COLOURS = (BLUE, ORANGE, "#1d3b2a", "#b04a8b", "#f0d060")
#: Every so manieth point of the grid has an arrow.
_EVERY = 5
#: Differences below this do not show.
_SAME = 1e-3


def picture(portrait: Portrait, title: str) -> Figure:
    """The SE above, the real task below, over the same two observations: what is rewarded, where it
    goes next and where it ends, and episodes in which the action that the SE rewards most is
    taken."""
    figure = Figure(figsize=(12.5, 8), layout="constrained")
    figure.suptitle(title)
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    (rewards, course, synthetic), (real_rewards, real_course, real) = panels
    task_id = portrait.se.task_id
    _rewards(rewards, portrait)
    _course(course, portrait, portrait.transitions, "the SE")
    _episodes(synthetic, portrait, portrait.synthetic)
    synthetic.set_title("episodes on the SE", fontsize="medium")
    _real_rewards(real_rewards, portrait)
    _course(real_course, portrait, portrait.real_transitions, task_id)
    _episodes(real, portrait, portrait.real)
    mean = np.mean([episode.total for episode in portrait.real])
    real.set_title(f"{task_id}, by the SE's rewards: return {mean:.1f}", fontsize="medium")
    across, up = portrait.plane.names
    for axes in panels[1]:
        axes.set_xlabel(across)
    for axes in panels[:, 0]:
        axes.set_ylabel(up)
    low, high = portrait.plane.axes[0][[0, -1]], portrait.plane.axes[1][[0, -1]]
    rewards.set_xlim(*low)
    rewards.set_ylim(*high)
    names = [Patch(color=_colour(n), label=name) for n, name in enumerate(portrait.actions)]
    names.append(Patch(color=GREY, label="whatever the action"))
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
    axes.set_title("the action that the SE rewards most (pale: by little)", fontsize="medium")


def _real_rewards(axes: Axes, portrait: Portrait) -> None:
    """The real task's rewards, averaged over the actions."""
    found = portrait.real_transitions
    if np.nanmax(found.rewards) - np.nanmin(found.rewards) < _SAME:
        axes.set_facecolor("#e8e8ec")
        told = f": {np.nanmax(found.rewards):g}, whatever the action"
    else:
        i, j = portrait.plane.indices
        values = np.nanmean(found.rewards, axis=0)
        shown = axes.scatter(found.states[:, i], found.states[:, j], c=values, s=9, cmap="Greys_r")
        axes.figure.colorbar(shown, ax=axes, shrink=0.8)
        told = ", averaged over the actions"
    axes.set_title(f"rewards of {portrait.se.task_id}{told}", fontsize="medium")


def _course(axes: Axes, portrait: Portrait, found: TransitionField, what: str) -> None:
    """Where states lead, an arrow for each action if these differ, and where episodes end."""
    i, j = portrait.plane.indices
    gaps = [float(axis[1] - axis[0]) * _EVERY for axis in portrait.plane.axes]
    thin = found.grid(_EVERY) if found.whole else found
    moves = (thin.following - thin.states)[..., [i, j]] / gaps  # (A, n, 2), in gaps between arrows
    longest = float(np.nanpercentile(np.linalg.norm(moves, axis=-1), 98))
    apart = float(np.nanmax(np.ptp(moves, axis=0))) if found.whole else np.inf
    actions = range(1) if apart < _SAME * longest else range(len(moves))
    for action in actions:
        axes.quiver(
            *(thin.states[:, i], thin.states[:, j]),
            *(moves[action] * gaps / max(longest, 1e-9)).T,
            color=GREY if len(actions) == 1 else _colour(action),
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.003,
        )
    told = "hatched: it ends"
    if found.whole:
        _ends(axes, portrait, found.ends.any(axis=0).reshape(GRID, GRID))
    else:
        last = found.ends.any(axis=0)
        axes.scatter(found.states[last, i], found.states[last, j], marker="x", c="black", s=20)
        told = f"{len(found.states)} random steps"
    axes.set_title(f"where {what} goes next; {told}", fontsize="medium")


def _ends(axes: Axes, portrait: Portrait, ends: NDArray[np.bool_]) -> None:
    """Hatch the grid's states (GRID, GRID) in which an episode ends."""
    across, up = portrait.plane.axes
    if ends.any():
        axes.contourf(across, up, ends, levels=[0.5, np.inf], colors="none", hatches=["///"])
    if ends.any() and not ends.all():
        axes.contour(across, up, ends, levels=[0.5], colors="black", linewidths=1)


def _episodes(axes: Axes, portrait: Portrait, episodes: list[Episode]) -> None:
    """Paths of episodes, each state in the colour of the action taken there."""
    i, j = portrait.plane.indices
    for episode in episodes:
        path = episode.states
        axes.plot(path[:, i], path[:, j], color=GREY, lw=0.6, alpha=0.6)
        colours = [_colour(action) for action in episode.actions]
        axes.scatter(path[:-1, i], path[:-1, j], c=colours, s=6, zorder=3)
        axes.scatter(path[0, i], path[0, j], marker="o", s=30, fc="none", ec="black", zorder=4)
