"""`transfer`: test returns of fresh agents by training environment.

See the paper's figures on evaluation performance and on transfer.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bilevel.tasks import Task
from cluster.evaluate.report import Group
from cluster.experiments.agents import Evaluation, Plan, evaluations_on
from cluster.experiments.authors import PICKED
from cluster.experiments.conditions import REAL, title_of
from cluster.experiments.experiment import Experiment, Findings, Material
from cluster.experiments.style import LOOKS, column, number, solved_line, violin
from cluster.experiments.table import Row, standard_error

#: Training environments in the order of the paper's violins, followed by ours.
SOURCES = (REAL, "varied", "fixed", "default")


def _agents(task_id: str) -> tuple[str, ...]:
    return ("ddqn", "dueling-ddqn", *(["td3"] if task_id == "CartPole-v0" else []))


def _evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    sources, size = material.on(*SOURCES), plan.size
    return evaluations_on(plan, sources, plan.kinds, size.agents, size.real_agents)


def _findings(plan: Plan, material: Material) -> Findings:
    evaluations = _evaluations(plan, material)
    data = material.agents(evaluations)
    results = [material.result(evaluation) for evaluation in evaluations]
    groups, summary = [], []
    for (agent, source), rows in data.groupby(["agent", "source"], sort=False):
        group = Group(source, agent, plan.task.solved_reward, tuple(results[i] for i in rows.index))
        groups.append(group)
        summary.append(_summary(group, rows))
    lowest = min(float(group.test_returns.min()) for group in groups)
    return Findings(
        data,
        summary,
        {
            hp.agent: violins([g for g in groups if g.agent == hp.agent], plan.task, lowest)
            for hp in plan.kinds
        },
        {f"test_return/{g.agent}/{g.source}": float(g.test_returns.mean()) for g in groups},
        (
            "The agents' learning rate, batch size and network are always drawn from the paper's "
            "ranges. Agents at the same position are equal on all sources.",
            "Test returns are statistics over test episodes, train steps and train episodes over "
            f"agents. The {PICKED} best SEs are chosen by the returns shown, as the authors did, "
            "which overestimates the return on a new SE.",
            "All SEs count, whether or not their NES runs solved the task. The authors used only "
            "SEs of runs that had.",
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
        "standard_error_over_ses": float(standard_error(np.array(means)))
        if len(means) > 1
        else None,
        "train_steps": s["train_steps_mean"],
        "train_steps_std": s["train_steps_std"],
        "train_steps_median": s["train_steps_median"],
        "train_episodes": s["train_episodes_mean"],
        "train_episodes_std": s["train_episodes_std"],
        "share_of_agents_solving": s["solved_fraction"],
        "five_best_ses": float(np.mean(means[:PICKED])) if len(means) > PICKED else None,
    }


def violins(groups: Sequence[Group], task: Task, lowest: float) -> Figure:
    """Draw a violin of test returns per source on an axis that starts at `lowest`; means above,
    train steps and episodes below."""
    figure = column(3.0)
    axes = figure.subplots()
    for x, group in enumerate(groups):
        returns = group.test_returns
        violin(axes, x, returns, LOOKS[group.source])
        axes.annotate(
            number(returns.mean(), ".1f"),
            (x, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
        )
    solved_line(axes, task.solved_reward)
    axes.set_ylabel(f"test return on {task.id}")
    axes.set_xlim(-0.6, len(groups) - 0.4)
    highest = max(float(group.test_returns.max()) for group in groups)
    low, high = min(lowest, task.solved_reward), max(highest, task.solved_reward)
    margin = 0.05 * max(high - low, 1.0)
    axes.set_ylim(low - margin, high + margin)
    axes.set_xticks(range(len(groups)), [_label(group) for group in groups], fontsize=5.8)
    axes.set_title(f"{groups[0].agent} (above: mean)", pad=11)
    return figure


def _label(group: Group) -> str:
    steps, episodes = group.train_steps, group.train_episodes
    return (
        f"{title_of(group.source)}\n{len(group.results)} agents\n"
        f"train steps\n{steps.mean():.0f} ± {steps.std():.0f}\n"
        f"episodes\n{episodes.mean():.0f} ± {episodes.std():.0f}"
    )


TRANSFER = Experiment(
    "transfer",
    "Performance and transfer of agents",
    "Test returns on the real task of fresh agents that were trained on the real task, and on SEs "
    "that NES learned with DDQN agents. Bars are quartiles, white dots medians, diamonds means, "
    "and the dotted line is the return that solves the task.",
    lambda size: dict.fromkeys(("varied", "fixed", "default"), size.ses),
    _findings,
    _evaluations,
    agents=_agents,
)
