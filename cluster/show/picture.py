"""The picture of an SE."""

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from cluster.pictures import BLUE, GREY, ORANGE
from cluster.show.portrait import GRID, Episode, Portrait, TransitionField

#: Colours of actions, told apart also in grey.
_COLOURS = (BLUE, ORANGE, "#1d3b2a", "#b04a8b", "#f0d060")
#: Marks of first states, and of the last ones that random steps have met.
_START: dict[str, Any] = {"marker": "o", "ms": 5.5, "mfc": "none", "mec": "black"}
_END: dict[str, Any] = {"marker": "x", "ms": 4.5, "mec": "black"}
#: Entries of the legend in a line, at most.
_COLUMNS = 6
#: Every so manieth point of the grid has an arrow.
_EVERY = 5
#: Differences below this do not show.
_SAME = 1e-3


def picture(portrait: Portrait, title: str) -> Figure:
    """The SE above, the real task below, over the same two observations: what is rewarded, where it
    goes next and where it ends, and episodes in which the action that the SE rewards most is
    taken."""
    figure = Figure(figsize=(12.5, 8), layout="constrained")
    size = portrait.se.architecture.state_size
    rest = ", the others at their means" if size > 2 else ""
    which = "its observation (on both axes)" if size == 1 else f"two observations{rest}"
    figure.suptitle(f"{title}, over {which}")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    (rewards, course, synthetic), (real_rewards, real_course, real) = panels
    _rewards(rewards, portrait)
    _course(course, portrait, portrait.transitions, "the SE")
    _episodes(synthetic, portrait, portrait.synthetic)
    synthetic.set_title("episodes on the SE", fontsize="medium")
    _real_rewards(real_rewards, portrait)
    _course(real_course, portrait, portrait.real_transitions, "the real task")
    _episodes(real, portrait, portrait.real)
    mean = np.mean([episode.total for episode in portrait.real])
    real.set_title(f"real episodes by the SE's rewards: return {mean:.1f}", fontsize="medium")
    across, up = portrait.plane.names
    for axes in panels[1]:
        axes.set_xlabel(across)
    for axes in panels[:, 0]:
        axes.set_ylabel(up)
    low, high = portrait.plane.axes[0][[0, -1]], portrait.plane.axes[1][[0, -1]]
    rewards.set_xlim(*low)
    rewards.set_ylim(*high)
    colours = _colours(len(portrait.actions))
    told: list[Artist] = [
        Patch(color=colour, label=name)
        for colour, name in zip(colours, portrait.actions, strict=True)
    ]
    told.append(Patch(color=GREY, label="whatever the action"))
    told.append(Line2D([], [], **_START, ls="none", label="an episode's first state"))
    real_steps = portrait.real_transitions
    if real_steps.ends.any() and not real_steps.whole:
        told.append(Line2D([], [], **_END, ls="none", label="where random steps ended an episode"))
    figure.legend(
        handles=told, loc="outside lower center", ncols=min(len(told), _COLUMNS), frameon=False
    )
    return figure


def _colours(actions: int) -> list[str]:
    """A colour for each action."""
    if actions <= len(_COLOURS):
        return list(_COLOURS[:actions])
    return [to_hex(colour) for colour in colormaps["turbo"](np.linspace(0, 1, actions))]


def _extent(portrait: Portrait) -> tuple[float, float, float, float]:
    across, up = portrait.plane.axes
    return float(across[0]), float(across[-1]), float(up[0]), float(up[-1])


def _rewards(axes: Axes, portrait: Portrait) -> None:
    """The action of the highest reward; the paler, the less it matters."""
    rewards = portrait.fields[1].reshape(-1, GRID, GRID)
    ordered = np.sort(rewards, axis=0)
    margin = ordered[-1] - ordered[-2] if len(ordered) > 1 else np.ones_like(ordered[0])
    strength = 0.15 + 0.85 * margin / max(float(margin.max()), 1e-9)
    colours = np.array([to_rgb(colour) for colour in _colours(len(rewards))])
    shown = 1 - strength[..., None] * (1 - colours[rewards.argmax(axis=0)])
    axes.imshow(shown, origin="lower", extent=_extent(portrait), aspect="auto")
    axes.set_title("the action that the SE rewards most (pale: by little)", fontsize="medium")


def _real_rewards(axes: Axes, portrait: Portrait) -> None:
    """The real task's rewards, averaged over the actions, or where random steps have met them, of
    the actions that these took."""
    found = portrait.real_transitions
    if np.nanmax(found.rewards) - np.nanmin(found.rewards) < _SAME:
        axes.set_facecolor("#e8e8ec")
        told = f": {np.nanmax(found.rewards):g}, whatever the action"
    else:
        i, j = portrait.plane.indices
        values = np.nanmean(found.rewards, axis=0)
        shown = axes.scatter(found.states[:, i], found.states[:, j], c=values, s=9)
        axes.figure.colorbar(shown, ax=axes, shrink=0.8, label="reward")
        told = ", averaged over the actions" if found.whole else " for a random action"
    axes.set_title(f"rewards of the real task{told}", fontsize="medium")


def _course(axes: Axes, portrait: Portrait, found: TransitionField, what: str) -> None:
    """Where states lead, an arrow for each action if these differ, and where episodes end."""
    i, j = portrait.plane.indices
    gaps = [float(axis[1] - axis[0]) * _EVERY for axis in portrait.plane.axes]
    thin = found.grid(_EVERY) if found.whole else found
    moves = (thin.following - thin.states)[..., [i, j]] / gaps  # (A, n, 2), in gaps between arrows
    longest = float(np.nanpercentile(np.linalg.norm(moves, axis=-1), 98))
    apart = float(np.nanmax(np.ptp(moves, axis=0))) if found.whole else np.inf
    colours = _colours(len(moves))
    actions = range(1) if apart < _SAME * longest else range(len(moves))
    for action in actions:
        axes.quiver(
            *(thin.states[:, i], thin.states[:, j]),
            *(moves[action] * gaps / max(longest, 1e-9)).T,
            color=GREY if len(actions) == 1 else colours[action],
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
        axes.plot(found.states[last, i], found.states[last, j], **_END, ls="none")
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
    of_action = _colours(len(portrait.actions))
    for episode in episodes:
        path = episode.states
        axes.plot(path[:, i], path[:, j], color=GREY, lw=0.6, alpha=0.6)
        colours = [of_action[action] for action in episode.actions]
        axes.scatter(path[:-1, i], path[:-1, j], c=colours, s=6, zorder=3)
        axes.plot(path[0, i], path[0, j], **_START, zorder=4)
