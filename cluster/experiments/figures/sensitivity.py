"""`sensitivity`: agents' returns against their hyperparameters, on one SE."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from bilevel.agents.variation import VARIED
from bilevel.tasks import Task
from cluster.evaluate.report import Row
from cluster.experiments.experiment import Evaluation, Experiment, Findings, Material, Plan
from cluster.experiments.style import SERIES, panels, solved_line


def _evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    return plan.evaluations(material.on("default"), plan.kinds, plan.size.varied_agents)


def _findings(plan: Plan, material: Material) -> Findings:
    data = material.agents(_evaluations(plan, material))
    figures: dict[str, Figure] = {}
    summary: list[Row] = []
    metrics: dict[str, float] = {}
    for agent, rows in data.groupby("agent", sort=False):
        varied = rows[[*VARIED]].dropna(axis="columns").astype(float)
        scores = rows["score"].astype(float)
        if not varied.empty:
            figures[agent] = scatter_plots(varied, scores, plan.task, agent)
        summary += [_summary(agent, name, varied[name], scores) for name in varied]
        metrics[f"test_return/{agent}"] = float(scores.mean())
    note = (
        f"All agents train on the SE with seed {plan.seed}, which was not selected. All "
        "hyperparameters are drawn at once, so each panel averages over the others."
    )
    return Findings(data, summary, figures, metrics, [note])


def _summary(agent: str, name: str, values: pd.Series, scores: pd.Series) -> Row:
    constant = np.ptp(values) == 0 or np.ptp(scores) == 0
    return {
        "agent": agent,
        "hyperparameter": name.replace("_", " "),
        "agents": len(scores),
        "from": float(values.min()),
        "to": float(values.max()),
        "rank_correlation": None if constant else float(spearmanr(values, scores).statistic),
    }


def scatter_plots(varied: pd.DataFrame, scores: pd.Series, task: Task, agent: str) -> Figure:
    """Draw a panel per hyperparameter with a point per agent."""
    figure, drawn = panels(len(varied.columns), 1.4, sharey=True)
    for axes, name in zip(drawn, varied, strict=True):
        axes.scatter(varied[name], scores, s=8, color=SERIES[0], alpha=0.5, lw=0)
        axes.set_xlabel(name.replace("_", " "))
        solved_line(axes, task.solved_reward)
    figure.supylabel(f"mean test return on {task.id}")
    figure.suptitle(agent)
    return figure


SENSITIVITY = Experiment(
    "sensitivity",
    "Sensitivity to agents' hyperparameters",
    "Scores of agents trained on one SE against each varied hyperparameter.",
    lambda size: {"default": 1},
    _findings,
    _evaluations,
)
