"""`transfer`: test returns of fresh agents by training environment (paper, Figure "transfer")."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import sem

from bilevel.tasks import Task
from cluster.evaluate.report import Group, Row
from cluster.experiments.conditions import REAL, title_of
from cluster.experiments.experiment import Evaluation, Experiment, Findings, Material, Plan
from cluster.experiments.style import COLOURS, column, solved_line

#: SEs that the authors chose for their best result of TD3.
PICKED = 5


def _evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    sources, size = material.on(REAL, "varied", "fixed", "default"), plan.size
    return plan.evaluations(sources, plan.kinds, size.agents, size.real_agents)


def _findings(plan: Plan, material: Material) -> Findings:
    evaluations = _evaluations(plan, material)
    data = material.agents(evaluations)
    results = [material.found[evaluation.key] for evaluation in evaluations]
    groups, summary = [], []
    for (agent, source), rows in data.groupby(["agent", "source"], sort=False):
        group = Group(source, agent, plan.task.solved_reward, tuple(results[i] for i in rows.index))
        groups.append(group)
        summary.append(_summary(group, rows))
    return Findings(
        data,
        summary,
        {
            hp.agent: violins([g for g in groups if g.agent == hp.agent], plan.task)
            for hp in plan.kinds
        },
        {f"test_return/{g.agent}/{g.source}": float(g.test_returns.mean()) for g in groups},
        (
            "Agents have hyperparameters from the paper's ranges, equal at the same position of "
            "all sources. Test returns are statistics over test episodes.",
            f"The {PICKED} best SEs are chosen by the returns shown, as the authors did, which "
            "overestimates the return on a new SE. The authors used only SEs of solved runs.",
        ),
    )


def _summary(group: Group, rows: pd.DataFrame) -> Row:
    s = group.summary()
    by_se = rows.groupby("se", dropna=False)["score"]  # the real task is one group
    means = sorted((float(np.mean([*scores])) for _, scores in by_se), reverse=True)
    return {
        "agent": group.agent,
        "source": group.source,
        "ses": None if group.source == REAL else len(means),
        "agents": len(rows),
        "evaluations": group.test_returns.size,
        "test_return": s["test_returns_mean"],
        "test_return_std": s["test_returns_std"],
        "standard_error_over_ses": float(sem(means)) if len(means) > 1 else None,
        "train_steps": s["train_steps_mean"],
        "train_steps_std": s["train_steps_std"],
        "train_steps_median": s["train_steps_median"],
        "train_episodes": s["train_episodes_mean"],
        "train_episodes_std": s["train_episodes_std"],
        "share_of_agents_solving": s["solved_fraction"],
        "five_best_ses": float(np.mean(means[:PICKED])) if len(means) > PICKED else None,
    }


def violins(groups: Sequence[Group], task: Task) -> Figure:
    """Draw a violin of test returns per source, with a line at the mean."""
    figure = column(2.7)
    axes = figure.subplots()
    parts: Any = axes.violinplot(
        [group.test_returns for group in groups], range(len(groups)), widths=0.8, showmeans=True
    )
    for body, group in zip(parts["bodies"], groups, strict=True):
        body.set_facecolor(COLOURS[group.source])
    labels = [
        f"{title_of(g.source)}\nmean {g.test_returns.mean():.1f}\n{len(g.results)} agents"
        for g in groups
    ]
    axes.set_xticks(range(len(groups)), labels)
    solved_line(axes, task.solved_reward)
    axes.set_ylabel(f"test return on {task.id}")
    axes.set_title(groups[0].agent)
    return figure


TRANSFER = Experiment(
    "transfer",
    "Performance and transfer of agents",
    "Test returns on the real task of fresh agents that were trained on the real task, and on SEs "
    "that NES learned with DDQN agents. The dotted line is the return that solves the task.",
    lambda size: dict.fromkeys(("varied", "fixed", "default"), size.ses),
    _findings,
    _evaluations,
    lambda task_id: ("ddqn", "dueling-ddqn", *(["td3"] if task_id == "CartPole-v0" else [])),
)
