"""`sensitivity`: agents' returns against their hyperparameters, on one SE."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator, ScalarFormatter
from numpy.typing import NDArray
from scipy.stats import spearmanr

from bilevel.tasks import Task
from cluster.experiments.agents import Place, Unit
from cluster.experiments.experiment import Experiment, Findings, Material, Plan
from cluster.experiments.figures.transfer import agent_row
from cluster.experiments.sizes import Size
from cluster.experiments.style import SERIES, column, solved_line
from cluster.experiments.table import Row, standard_error

Floats = NDArray[np.float64]

#: The hyperparameters that are drawn, their names in pictures, and the ticks of their axes.
VARIED = {
    "learning_rate": ("learning rate", (3e-4, 1e-3, 3e-3)),
    "batch_size": ("batch size", (50, 100, 200, 400)),
    "hidden_size": ("hidden units a layer", (50, 100, 200, 400)),
    "hidden_layers": ("hidden layers", (1, 2, 3)),
}

#: Groups of agents whose means are drawn.
_FIFTHS = 5


def _runs(size: Size) -> dict[str, int]:
    return {"default": 1}


def _units(plan: Plan, material: Material) -> list[Unit]:
    (source,) = material.of("default")
    return [
        Unit.of(plan.task, source, Place(0, agent), kind, plan.seed)
        for kind in plan.kinds
        for agent in range(plan.size.varied_agents)
    ]


def grouped(values: Floats) -> list[NDArray[np.intp]]:
    """Indices of the agents, ordered by a hyperparameter: a group for each value if there are
    few, else fifths."""
    distinct = np.unique(values)
    if len(distinct) <= _FIFTHS:
        return [np.flatnonzero(values == value) for value in distinct]
    return np.array_split(np.argsort(values, kind="stable"), _FIFTHS)


def _findings(plan: Plan, material: Material) -> Findings:
    units = _units(plan, material)
    figures: dict[str, Figure] = {}
    summary: list[Row] = []
    metrics: dict[str, float] = {}
    for kind in plan.kinds:
        own = [unit for unit in units if unit.hp.agent == kind.agent]
        scores = np.array([material.found[unit.key].score for unit in own])
        values = {
            name: np.array([getattr(unit.hp, name) for unit in own], np.float64)
            for name in VARIED
            if hasattr(kind, name)
        }
        if values:
            figures[kind.agent] = panels(values, scores, plan.task, kind.agent)
        summary += [_summary(kind.agent, name, one, scores) for name, one in values.items()]
        metrics[f"test_return/{kind.agent}"] = float(scores.mean())
    return Findings(
        [agent_row(unit, material) for unit in units],
        summary,
        figures,
        metrics,
        (
            f"All agents train on the SE with seed {plan.seed}, which was not chosen. All "
            "hyperparameters are drawn at once, so each panel averages over the others.",
        ),
    )


def _summary(agent: str, name: str, values: Floats, scores: Floats) -> Row:
    groups = [scores[group] for group in grouped(values)]
    constant = np.ptp(values) == 0 or np.ptp(scores) == 0
    return {
        "agent": agent,
        "hyperparameter": VARIED[name][0],
        "agents": len(scores),
        "from": float(values.min()),
        "to": float(values.max()),
        "return_of_lowest_group": float(groups[0].mean()),
        "return_of_highest_group": float(groups[-1].mean()),
        "rank_correlation": None if constant else float(spearmanr(values, scores).statistic),
    }


def panels(values: dict[str, Floats], scores: Floats, task: Task, kind: str) -> Figure:
    """A panel for each hyperparameter: a point an agent, and means with standard errors."""
    rows = -(-len(values) // 2)
    figure = column(0.55 + 1.45 * rows)
    drawn: Sequence[Axes] = list(figure.subplots(rows, 2, sharey=True, squeeze=False).flat)
    look, line = SERIES[0], SERIES[1]
    for axes, (name, at) in zip(drawn, values.items(), strict=False):
        title, ticks = VARIED[name]
        axes.scatter(at, scores, s=8, color=look.colour, alpha=0.5, lw=0, marker=look.marker)
        groups = grouped(at)
        axes.errorbar(
            [float(np.exp(np.log(at[group]).mean())) for group in groups],
            [float(scores[group].mean()) for group in groups],
            [_error(scores[group]) for group in groups],
            color=line.colour,
            ls=line.line,
            marker=line.marker,
            mec="black",
            mew=0.5,
            capsize=2,
        )
        if name != "hidden_layers":
            axes.set_xscale("log")
        axes.set_xticks(ticks)
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel(title)
        solved_line(axes, task.solved_reward)
    for axes in drawn[len(values) :]:
        axes.set_visible(False)
    figure.supylabel(f"mean test return on {task.id}", fontsize=7.5)
    told = "dots: agents; squares: means of groups\nwith their standard errors"
    figure.suptitle(f"{kind} ({told})", fontsize=8)
    return figure


def _error(scores: Floats) -> float:
    """Standard error of the mean; NaN, which draws no bar, of a single score."""
    return float(standard_error(scores)) if len(scores) > 1 else math.nan


SENSITIVITY = Experiment(
    "sensitivity",
    "Sensitivity to agents' hyperparameters",
    "Scores of agents trained on one SE against each hyperparameter that is varied.",
    _runs,
    _findings,
    _units,
)
