"""Statistics, table and picture of an evaluation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationResult, comparable
from bilevel.tasks import Task
from cluster.pictures import BLUE, ORANGE


@dataclass(frozen=True)
class Group:
    """Agents of one kind, trained on one source."""

    source: str  # label of an SE, or "real"
    agent: str
    solved_reward: float
    results: tuple[EvaluationResult, ...]

    @property
    def test_returns(self) -> NDArray[np.float64]:
        """Returns of all test episodes of all agents."""
        return np.concatenate([result.test_returns for result in self.results])

    @property
    def scores(self) -> NDArray[np.float64]:
        """Mean test return (n,) of each agent."""
        return np.array([result.score for result in self.results])

    @property
    def train_steps(self) -> NDArray[np.float64]:
        """Train steps (n,) of the agents."""
        return np.array([result.train_steps for result in self.results], np.float64)

    @property
    def train_episodes(self) -> NDArray[np.float64]:
        """Train episodes (n,) of the agents."""
        return np.array([result.train_episodes for result in self.results], np.float64)

    def summary(self) -> dict[str, float]:
        """Return mean, standard deviation and quartiles of test returns, train steps and train
        episodes, the fraction of agents that solve the task, and the number of diverged agents."""
        values: dict[str, float] = {"agents": float(len(self.results))}
        for name in ("test_returns", "train_steps", "train_episodes"):
            array = getattr(self, name)
            values |= {f"{name}_mean": float(array.mean()), f"{name}_std": float(array.std())}
            quartiles = np.quantile(array, (0.25, 0.5, 0.75))
            for quartile, value in zip(("q1", "median", "q3"), quartiles, strict=True):
                values[f"{name}_{quartile}"] = float(value)
        values["solved_fraction"] = float((self.scores >= self.solved_reward).mean())
        values["non_finite"] = float(sum(not result.finite for result in self.results))
        return values


def groups_of(
    results: Mapping[tuple[str, str], Sequence[EvaluationResult]], solved_reward: float
) -> list[Group]:
    """Return a group per source and kind of agent, with comparable scores of diverged agents."""
    levelled = iter(comparable([one for group in results.values() for one in group]))
    return [
        Group(source, agent, solved_reward, tuple(islice(levelled, len(group))))
        for (source, agent), group in results.items()
    ]


def as_json(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Return the summaries, one dictionary per group."""
    return [{"source": g.source, "agent": g.agent, **g.summary()} for g in groups]


def as_table(groups: Sequence[Group]) -> list[str]:
    """Return the summaries as lines of text."""
    s = pd.DataFrame(as_json(groups))
    columns = {
        "trained on": s["source"],
        "agent": s["agent"],
        "n": s["agents"].map("{:.0f}".format),
        "test return": _with_spread(s, "test_returns", 1),
        "solved": s["solved_fraction"].map("{:.0%}".format),
        "train steps": _with_spread(s, "train_steps", 0),
        "episodes": _with_spread(s, "train_episodes", 0),
    }
    if s["non_finite"].any():
        columns["diverged"] = s["non_finite"].map("{:.0f}".format)
    text: str = pd.DataFrame(columns).to_string(index=False)
    return text.splitlines()


def _with_spread(summaries: pd.DataFrame, name: str, digits: int) -> pd.Series:
    mean, spread = (
        summaries[f"{name}_{part}"].map(f"{{:.{digits}f}}".format) for part in ("mean", "std")
    )
    return mean + " ± " + spread


def picture(groups: Sequence[Group], task: Task, title: str) -> Figure:
    """Draw scores and, below, train steps by group: a point per agent, box plots and means."""
    figure = Figure(figsize=(max(5.0, 1.9 * len(groups) + 1.5), 6), layout="constrained")
    scores, steps = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.4])
    labels = [f"{g.agent}\non {g.source}\nn = {len(g.results)}" for g in groups]
    for axes, values in (
        (scores, [group.scores for group in groups]),
        (steps, [group.train_steps for group in groups]),
    ):
        axes.boxplot(values, tick_labels=labels, showmeans=True, showfliers=False)
        for x, of_group in enumerate(values, start=1):
            # Offsets in the order of the agents, so that equal results have equal pictures.
            offsets = np.linspace(-0.18, 0.18, len(of_group))
            axes.scatter(x + offsets, of_group, s=14, color=BLUE, alpha=0.6, lw=0)
        axes.spines[["top", "right"]].set_visible(False)
    scores.axhline(task.solved_reward, color=ORANGE, ls="--", lw=1, label="solved")
    scores.legend(frameon=False, fontsize="small", loc="lower left")
    scores.set(ylabel=f"mean test return on {task.id}", title=title)
    steps.set_ylabel("train steps (triangles: means)")
    steps.set_ylim(bottom=0)
    return figure
