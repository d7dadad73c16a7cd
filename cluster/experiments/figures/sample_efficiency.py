"""`sample-efficiency`: the real return of agents against their train steps.

The return after k episodes is measured with an agent that trains for at most k episodes. Training
is a pure function of its seed and the limit of episodes has no other effect, so a longer training
passes through the same agent. k grows by factors of 1.4 until training stops by its own rule, which
costs about three and a half times the training.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import AgentHyperparameters
from cluster.evaluate.report import Row
from cluster.experiments.conditions import REAL
from cluster.experiments.experiment import Evaluation, Experiment, Findings, Found, Material, Plan
from cluster.experiments.style import line_chart, solved_line

Floats = NDArray[np.float64]

#: Train steps (k,) and scores (k,) of an agent.
Curve = tuple[Floats, Floats]

#: Factor between the episode limits of an agent, and points of a drawn curve.
_FACTOR, _POINTS = 1.4, 80


def episode_limits(hp: AgentHyperparameters) -> list[int]:
    """Return the numbers of episodes after which an agent is tested, from the last one without a
    gradient step to its maximum."""
    limits = [max(hp.init_episodes, 1)]
    while limits[-1] < hp.max_episodes:
        further = max(round(limits[-1] * _FACTOR), limits[-1] + 1)
        limits.append(min(further, hp.max_episodes))
    return limits


def shorter_trainings(evaluation: Evaluation, found: Found) -> list[Evaluation]:
    """Return the agent at each episode limit until training stops by its own rule. Ends at the
    first missing result."""
    trainings: list[Evaluation] = []
    for episodes in episode_limits(evaluation.hp):
        shorter = replace(evaluation.hp, max_episodes=episodes)
        trainings.append(replace(evaluation, hp=shorter))
        result = found.get(trainings[-1].key)
        if result is None or result.train_episodes < episodes:
            break
    return trainings


def _evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    per_se = plan.size.curve_agents
    on_real = per_se * plan.size.curve_ses
    agents = plan.evaluations(
        material.on("default", REAL), plan.kinds[:1], per_se, on_real=on_real, per_se=per_se
    )
    return [one for agent in agents for one in shorter_trainings(agent, material.found)]


def scores_at(steps: Floats, curves: Sequence[Curve]) -> Floats:
    """Return the scores (agents, n) after `steps` (n,). Each agent has the score of its last test
    until then, or of its first one."""
    return np.stack(
        [
            scores[np.clip(np.searchsorted(at, steps, side="right") - 1, 0, len(at) - 1)]
            for at, scores in curves
        ]
    )


def _findings(plan: Plan, material: Material) -> Findings:
    data = material.agents(_evaluations(plan, material))
    data = data[["source", "position", "train_steps", "score"]]
    curves = {
        source: [
            (agent["train_steps"].to_numpy(float), agent["score"].to_numpy(float))
            for _, agent in rows.groupby("position", sort=False)
        ]
        for source, rows in data.groupby("source", sort=False)
    }
    means, task = {name: mean_curve(each) for name, each in curves.items()}, plan.task
    summary = [
        _summary(name, each, means[name], task.solved_reward) for name, each in curves.items()
    ]
    figure = line_chart(
        means,
        xscale="log",
        xlabel=f"train steps of a {plan.kinds[0].agent} agent",
        ylabel=f"mean test return on {task.id}",
    )
    solved_line(figure.axes[0], task.solved_reward)
    return Findings(
        data,
        summary,
        {"curves": figure},
        {f"final_return/{row['source']}": float(row["return_at_stop"] or 0) for row in summary},
        (
            "Agents train until their stopping rule holds, and keep their last return in the "
            "means. Their hyperparameters are drawn from the paper's ranges.",
        ),
    )


def mean_curve(curves: Sequence[Curve]) -> Curve:
    """Return the mean score of the agents after increasing train steps."""
    first = min(float(at[0]) for at, _ in curves)
    last = max(float(at[-1]) for at, _ in curves)
    steps = np.geomspace(max(first, 1.0), max(last, 2.0), _POINTS)
    return steps, scores_at(steps, curves).mean(axis=0)


def _summary(name: str, curves: Sequence[Curve], mean: Curve, solved_reward: float) -> Row:
    steps = np.array([at[-1] for at, _ in curves])
    ends = np.array([scores[-1] for _, scores in curves])
    solved = mean[0][mean[1] >= solved_reward]
    return {
        "source": name,
        "agents": len(curves),
        "train_steps_at_stop": float(steps.mean()),
        "train_steps_at_stop_std": float(steps.std()),
        "return_at_stop": float(ends.mean()),
        "return_at_stop_std": float(ends.std()),
        "train_steps_until_mean_return_solves": float(solved[0]) if solved.size else None,
    }


SAMPLE_EFFICIENCY = Experiment(
    "sample-efficiency",
    "Sample efficiency of agents",
    "The mean return on the real task of the same agents against their train steps, on SEs and on "
    "the real task.",
    lambda size: {"default": size.curve_ses},
    _findings,
    _evaluations,
)
