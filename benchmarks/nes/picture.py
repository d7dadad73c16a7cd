"""The pictures of docs/nes.md, from the committed results.

python -m benchmarks.nes.picture
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from benchmarks.machine import read_result
from benchmarks.nes.study import AGENTS
from benchmarks.nes.tables import TASKS
from benchmarks.pictures import digest, grid, save, steps_and_scores
from bilevel.tasks import get_task

PICTURE = Path(__file__).parents[2] / "docs" / "nes.svg"
RULES_PICTURE = PICTURE.with_name("update_rules.svg")

_COLOURS = ("#2a6fbb", "#3d9970", "#d9822b", "#8a8f98", "#b04a8b", "#7f6bb0", "#c0504d", "#555555")


def _variants(task: str) -> dict[str, list[dict[str, Any]]]:
    found = read_result(f"nes_{task}")["variants"]
    return {name: variant["runs"] for name, variant in found.items()}


def _rules(task: str) -> dict[str, list[dict[str, Any]]]:
    found = read_result(f"update_rules_{task}")["rules"]
    return {name: rule["runs"] for name, rule in found.items()}


def _limits(task: str) -> dict[str, list[dict[str, Any]]]:
    points: dict[str, list[dict[str, Any]]] = read_result(f"step_limits_{task}")["points"]
    return points


def _curves(axes: Axes, task: str) -> None:
    """Every run of the defaults, and the median; a run that stopped keeps its last score."""
    runs = _variants(task)["defaults"]
    longest = max(run["generations"] for run in runs)
    curves = [run["score_curve"] for run in runs]
    filled = np.array([[*curve, *[curve[-1]] * (longest - len(curve))] for curve in curves])
    for curve in curves:
        axes.plot(curve, color=_COLOURS[0], alpha=0.3, lw=0.9)
    axes.plot(np.median(filled, axis=0), color=_COLOURS[0], lw=2.2)
    solved = get_task(task).solved_reward
    axes.axhline(solved, color="black", lw=0.8, ls=":")
    axes.annotate("solved", (longest, solved), ha="right", va="bottom", fontsize=8)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("generation")
    axes.set_ylabel("score of psi")
    axes.set_title(f"{task}: {len(runs)} seed(s), and their median")


def _update_rules(axes: Axes, task: str) -> None:
    """From random starts: the median run of each rule, with the transform that ends highest."""
    found = _rules(task)
    ends = {name: _median(runs)[-1] for name, runs in found.items()}
    shown = [name for name in found if "," not in name or name == "paired, adapted"]
    for update in ("paper", "authors"):
        shown.append(max((n for n in found if n.startswith(f"{update}, ")), key=ends.__getitem__))
    for name, colour in zip(shown, _COLOURS, strict=False):
        for run in found[name]:
            axes.plot(run["score_curve"], color=colour, alpha=0.2, lw=0.7)
        label = f"{name} ({len(found[name])} seeds)"
        axes.plot(_median(found[name]), color=colour, lw=2.0, label=label)
    axes.axhline(get_task(task).solved_reward, color="black", lw=0.8, ls=":")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("generation")
    axes.set_ylabel("score of psi")
    axes.set_title(f"{task}: update rules from random starts")
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))


def _every_rule(axes: Axes, task: str) -> None:
    """Fresh agents on the best SE of every run, a row a rule; its median a stroke."""
    found = _rules(task)
    for row, runs in enumerate(found.values()):
        scores = [run["best"]["score_mean"] for run in runs]
        axes.scatter(scores, [row] * len(runs), color=_COLOURS[0], s=20, alpha=0.6)
        axes.scatter(np.median(scores), row, marker="|", color="black", s=140)
    axes.axvline(get_task(task).solved_reward, color="black", lw=0.8, ls=":")
    axes.set_yticks(range(len(found)), list(found), fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("test return of fresh agents (mean) on the best SE")
    axes.set_title(f"{task}: every rule and transform")


def _median(runs: list[dict[str, Any]]) -> NDArray[np.float64]:
    curve: NDArray[np.float64] = np.median([run["score_curve"] for run in runs], axis=0)
    return curve


def _step_limits(axes: Axes, task: str) -> None:
    """Train steps and test return at every step limit, a line an agent; means over SEs."""
    for (agent, points), colour in zip(_limits(task).items(), _COLOURS, strict=False):
        steps, scores = (
            [np.mean([se[field] for se in point["ses"]]) for point in points]
            for field in ("train_steps_mean", "score_mean")
        )
        axes.plot(steps, scores, "o-", color=colour, ms=4, lw=1.2, label=agent)
        if agent == AGENTS[-1]:  # the shares are those of all, in the same order
            for point, x, y in zip(points, steps, scores, strict=True):
                share, below = f"{point['share']:.0%}", (4, -9)
                axes.annotate(share, (x, y), below, textcoords="offset points", fontsize=8)
    axes.axhline(get_task(task).solved_reward, color="black", lw=0.8, ls=":")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:.0f}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("train steps (mean)")
    axes.set_ylabel("test return (mean)")
    axes.set_title(f"{task}: step limit of the SE, as a share of the task's")
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def _agents(axes: Axes, task: str) -> None:
    """Varied agents, a point a run's best SE."""
    groups = {}
    for agent, colour in zip(AGENTS, _COLOURS, strict=False):
        runs = _variants(task)["defaults"]
        found = [run["varied"][agent] for run in runs if agent in run["varied"]]
        if found:
            groups[f"{agent} ({len(found)} SEs)"] = (colour, found)
    steps_and_scores(axes, task, groups)
    axes.set_title(f"{task}: varied agents on the best SEs")


def picture() -> Figure:
    """What the defaults do."""
    return grid(TASKS, (_curves, _step_limits, _agents))


def update_rules_picture() -> Figure:
    """What update rules make of random starts."""
    return grid(TASKS, (_update_rules, _every_rule), width=8.0)


def results_digests() -> dict[Path, str]:
    """Of what each picture shows."""
    return {
        PICTURE: digest([[_variants(task)["defaults"], _limits(task)] for task in TASKS]),
        RULES_PICTURE: digest([_rules(task) for task in TASKS]),
    }


def main() -> None:
    """Write `docs/nes.svg` and `docs/update_rules.svg`."""
    digests = results_digests()
    save(picture(), PICTURE, digests[PICTURE])
    save(update_rules_picture(), RULES_PICTURE, digests[RULES_PICTURE])


if __name__ == "__main__":
    main()
