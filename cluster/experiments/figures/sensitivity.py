"""`sensitivity`: agents' returns against their hyperparameters, on one SE."""

import math

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator, ScalarFormatter
from numpy.typing import NDArray
from scipy.stats import spearmanr

from bilevel.tasks import Task
from cluster.experiments.agents import Evaluation, Plan, evaluations_on
from cluster.experiments.experiment import Experiment, Findings, Material
from cluster.experiments.style import SERIES, column, panels, solved_line
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


def _evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    return evaluations_on(plan, material.on("default"), plan.kinds, plan.size.varied_agents)


def grouped(values: Floats) -> list[NDArray[np.intp]]:
    """Return the indices of groups of agents, ordered by a hyperparameter: a group per value, or
    fifths if there are more than five values."""
    distinct = np.unique(values)
    if len(distinct) <= _FIFTHS:
        return [np.flatnonzero(values == value) for value in distinct]
    return np.array_split(np.argsort(values, kind="stable"), _FIFTHS)


def _findings(plan: Plan, material: Material) -> Findings:
    data = material.agents(_evaluations(plan, material))
    figures: dict[str, Figure] = {}
    summary: list[Row] = []
    metrics: dict[str, float] = {}
    for agent, rows in data.groupby("agent", sort=False):
        varied = rows[[*VARIED]].dropna(axis="columns").astype(float)
        scores = rows["score"].to_numpy(float)
        if not varied.empty:
            figures[agent] = scatter_plots(varied, scores, plan.task, agent)
        summary += [_summary(agent, name, varied[name].to_numpy(), scores) for name in varied]
        metrics[f"test_return/{agent}"] = float(scores.mean())
    note = (
        f"All agents train on the SE with seed {plan.seed}, which was not selected. All "
        "hyperparameters are drawn at once, so each panel averages over the others."
    )
    return Findings(data, summary, figures, metrics, [note])


def _summary(agent: str, name: str, values: Floats, scores: Floats) -> Row:
    groups = [scores[group] for group in grouped(values)]
    constant = np.ptp(values) == 0 or np.ptp(scores) == 0
    correlation = None if constant else float(spearmanr(values, scores).statistic)
    return {
        "agent": agent,
        "hyperparameter": VARIED[name][0],
        "agents": len(scores),
        "from": float(values.min()),
        "to": float(values.max()),
        "return_of_lowest_group": float(groups[0].mean()),
        "return_of_highest_group": float(groups[-1].mean()),
        "rank_correlation": correlation,
    }


def scatter_plots(varied: pd.DataFrame, scores: Floats, task: Task, agent: str) -> Figure:
    """Draw a panel per hyperparameter: a point per agent, and group means with standard errors."""
    figure = column(0.55 + 1.45 * -(-len(varied.columns) // 2))
    points, means = SERIES[:2]
    drawn = panels(figure, len(varied.columns), sharey=True)
    for axes, name in zip(drawn, varied, strict=True):
        title, ticks = VARIED[name]
        at = varied[name].to_numpy()
        axes.scatter(at, scores, s=8, color=points.colour, alpha=0.5, lw=0, marker=points.marker)
        groups = grouped(at)
        axes.errorbar(
            [float(np.exp(np.log(at[group]).mean())) for group in groups],
            [float(scores[group].mean()) for group in groups],
            # NaN draws no bar.
            [float(standard_error(scores[g])) if len(g) > 1 else math.nan for g in groups],
            **means.curve,
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
    figure.supylabel(f"mean test return on {task.id}", fontsize=7.5)
    legend = "dots: agents; squares: means of groups\nwith their standard errors"
    figure.suptitle(f"{agent} ({legend})", fontsize=8)
    return figure


SENSITIVITY = Experiment(
    "sensitivity",
    "Sensitivity to agents' hyperparameters",
    "Scores of agents trained on one SE against each varied hyperparameter.",
    lambda size: {"default": 1},
    _findings,
    _evaluations,
)
