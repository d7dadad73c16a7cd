"""`sample-efficiency`: the real return of agents against their train steps.

The point of an agent after k episodes is the test of the agent that trains for at most k episodes:
training is a pure function of its seed, and the limit of episodes enters nowhere else, so this is
the same agent as one that goes on. k climbs a ladder until training has stopped by itself; with
steps of 2/5 a ladder costs about three and a half times the training.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bilevel.hyperparameters import AgentHyperparameters
from bilevel.tasks import Task
from cluster.experiments.agents import Found, Place, Unit
from cluster.experiments.conditions import REAL, title_of
from cluster.experiments.experiment import Experiment, Findings, Material, Plan
from cluster.experiments.sizes import Size
from cluster.experiments.style import LOOKS, column, solved_line
from cluster.experiments.table import Row, standard_error

Floats = NDArray[np.float64]

SOURCES = ("default", REAL, "distilled")

#: Factor between the rungs of a ladder, and points of a curve.
_RUNG, _POINTS = 1.4, 80


def ladder(hp: AgentHyperparameters) -> list[int]:
    """Numbers of episodes after which an agent is tested: from the last one without a gradient
    step on to its maximum."""
    rungs = [max(hp.init_episodes, 1)]
    while rungs[-1] < hp.max_episodes:
        further = max(round(rungs[-1] * _RUNG), rungs[-1] + 1)
        rungs.append(min(further, hp.max_episodes))
    return rungs


def _runs(size: Size) -> dict[str, int]:
    return {"default": size.curve_ses, "distilled": size.curve_ses}


def _agents(plan: Plan, material: Material, name: str) -> list[Unit]:
    """The same agents on every source."""
    sources = material.of(name)
    if name == REAL:
        sources = sources * plan.size.curve_ses
    return [
        Unit.of(plan.task, source, Place(se, agent), plan.kinds[0], plan.seed)
        for se, source in enumerate(sources)
        for agent in range(plan.size.curve_agents)
    ]


def climbed(unit: Unit, found: Found) -> tuple[list[Unit], bool]:
    """The agent at each rung up to the one on which training stopped by itself, as far as results
    are there; whether that is all of them. The last one may lack its result."""
    rungs: list[Unit] = []
    for episodes in ladder(unit.hp):
        rungs.append(unit.shorter(episodes))
        result = found.get(rungs[-1].key)
        if result is None:
            return rungs, False
        if result.train_episodes < episodes:
            break
    return rungs, True


def _units(plan: Plan, material: Material) -> list[Unit]:
    units = []
    for name in SOURCES:
        for unit in _agents(plan, material, name):
            rungs, _ = climbed(unit, material.found)
            units += rungs
    return units


def steps_and_scores(unit: Unit, found: Found) -> tuple[Floats, Floats]:
    """Train steps (k,) and scores (k,) of an agent at its rungs."""
    results = [found[rung.key] for rung in climbed(unit, found)[0]]
    return (
        np.array([result.train_steps for result in results], np.float64),
        np.array([result.score for result in results]),
    )


def scores_at(steps: Floats, curves: Sequence[tuple[Floats, Floats]]) -> Floats:
    """Scores (agents, n) after `steps` (n,): each agent's at the last rung that it had reached; it
    keeps its first one before, and its last one after it has stopped."""
    return np.stack(
        [
            scores[np.clip(np.searchsorted(at, steps, side="right") - 1, 0, len(at) - 1)]
            for at, scores in curves
        ]
    )


def _findings(plan: Plan, material: Material) -> Findings:
    rows: list[Row] = []
    summary: list[Row] = []
    curves, samples = {}, {}
    for name in SOURCES:
        agents = _agents(plan, material, name)
        each = [steps_and_scores(unit, material.found) for unit in agents]
        curves[name] = each
        # Agents on one SE have it in common; those on the real task have nothing.
        samples[name] = len(agents) if name == REAL else plan.size.curve_ses
        for unit, (at, scores) in zip(agents, each, strict=True):
            facts = {"source": name, "position": f"{unit.place.se}-{unit.place.agent}"}
            rows += [
                {**facts, "train_steps": int(step), "score": float(score)}
                for step, score in zip(at, scores, strict=True)
            ]
        summary.append(_summary(name, each, plan.task.solved_reward))
    return Findings(
        rows,
        summary,
        {"curves": learning_curves(curves, samples, plan.task, plan.kinds[0].agent)},
        {f"final_return/{row['source']}": float(row["return_at_stop"] or 0) for row in summary},
        (
            "Agents train until their stopping rule holds, and keep their last return in the "
            "means; their hyperparameters are drawn from the paper's ranges. Standard errors are "
            "those over SEs, and on the real task over agents.",
            "Distilled SEs are the supervised baseline: regressed from action values that were "
            "learned on the real task, not found by NES.",
        ),
    )


def _grid(curves: Sequence[tuple[Floats, Floats]]) -> Floats:
    first = min(float(at[0]) for at, _ in curves)
    last = max(float(at[-1]) for at, _ in curves)
    return np.geomspace(max(first, 1.0), max(last, 2.0), _POINTS)


def _summary(name: str, each: Sequence[tuple[Floats, Floats]], solved_reward: float) -> Row:
    steps = np.array([at[-1] for at, _ in each])
    ends = np.array([scores[-1] for _, scores in each])
    grid = _grid(each)
    solved = np.flatnonzero(scores_at(grid, each).mean(axis=0) >= solved_reward)
    return {
        "source": name,
        "agents": len(each),
        "train_steps_at_stop": float(steps.mean()),
        "train_steps_at_stop_std": float(steps.std()),
        "return_at_stop": float(ends.mean()),
        "return_at_stop_std": float(ends.std()),
        "train_steps_until_mean_return_solves": float(grid[solved[0]]) if solved.size else None,
    }


def learning_curves(
    curves: Mapping[str, Sequence[tuple[Floats, Floats]]],
    samples: Mapping[str, int],
    task: Task,
    kind: str,
) -> Figure:
    """The mean return over train steps, by source, with its standard error over so many independent
    samples, to each of which as many consecutive curves belong."""
    figure = column(2.5)
    axes = figure.subplots()
    for name, each in curves.items():
        look, grid = LOOKS[name], _grid(each)
        scores = scores_at(grid, each)
        mean = scores.mean(axis=0)
        means = scores.reshape(samples[name], -1, len(grid)).mean(axis=1)
        error = standard_error(means) if len(means) > 1 else np.zeros_like(mean)
        axes.fill_between(grid, mean - error, mean + error, color=look.colour, alpha=0.2, lw=0)
        axes.plot(
            grid,
            mean,
            color=look.colour,
            ls=look.line,
            marker=look.marker,
            markevery=10,
            label=f"{title_of(name)} (n = {len(each)})",
        )
    solved_line(axes, task.solved_reward)
    axes.set_xscale("log")
    axes.set_xlabel("train steps of an agent")
    axes.set_ylabel(f"mean test return on {task.id}")
    axes.set_title(f"{kind}: mean and standard error")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


SAMPLE_EFFICIENCY = Experiment(
    "sample-efficiency",
    "Sample efficiency of agents",
    "The mean return on the real task of the same agents against the steps that they have trained "
    "for: on SEs of NES, on the real task, and on the supervised baseline's SEs.",
    _runs,
    _findings,
    _units,
)
