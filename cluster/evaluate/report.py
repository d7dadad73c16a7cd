"""Statistics, tables and pictures of evaluations and experiments."""

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

Value = str | float | int | None
Row = Mapping[str, Value]

#: Columns of the printed table.
_SHOWN = (
    *("source", "agent", "agents", "test_returns_mean", "test_returns_std", "solved_fraction"),
    *("train_steps_mean", "train_steps_std", "non_finite"),
)


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

    def summary(self) -> dict[str, float]:
        """Return mean, standard deviation and median of test returns, train steps and train
        episodes, the fraction of agents that solve the task, and the number of diverged agents."""
        episodes = np.array([result.train_episodes for result in self.results])
        values: dict[str, float] = {"agents": len(self.results)}
        for name, array in (
            ("test_returns", self.test_returns),
            ("train_steps", self.train_steps),
            ("train_episodes", episodes),
        ):
            values |= {f"{name}_mean": float(array.mean()), f"{name}_std": float(array.std())}
            values[f"{name}_median"] = float(np.median(array))
        values["solved_fraction"] = float((self.scores >= self.solved_reward).mean())
        values["non_finite"] = sum(not result.finite for result in self.results)
        return values


def groups_of(
    results: Mapping[tuple[str, str], Sequence[EvaluationResult]], solved_reward: float
) -> list[Group]:
    """Return a group per source and kind of agent, with comparable scores of diverged agents."""
    compared = iter(comparable([one for group in results.values() for one in group]))
    return [
        Group(source, agent, solved_reward, tuple(islice(compared, len(group))))
        for (source, agent), group in results.items()
    ]


def as_json(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Return the summaries, one dictionary per group."""
    return [{"source": g.source, "agent": g.agent, **g.summary()} for g in groups]


def as_table(groups: Sequence[Group]) -> str:
    """Return the main columns of the summaries as text."""
    rows: list[Row] = [{name: row[name] for name in _SHOWN} for row in as_json(groups)]
    return str(table(rows).to_string(index=False))


def picture(groups: Sequence[Group], task: Task, title: str) -> Figure:
    """Draw a point per agent and a box plot of the scores of each group."""
    figure = Figure(figsize=(max(5.0, 1.9 * len(groups) + 1.5), 4), layout="constrained")
    axes = figure.subplots()
    labels = [f"{g.agent}\non {g.source}\nn = {len(g.results)}" for g in groups]
    axes.boxplot([g.scores for g in groups], tick_labels=labels, showmeans=True, showfliers=False)
    for x, group in enumerate(groups, start=1):
        # Offsets in the order of the agents, so that equal results have equal pictures.
        offsets = np.linspace(-0.18, 0.18, len(group.results))
        axes.scatter(x + offsets, group.scores, s=14, color=BLUE, alpha=0.6, lw=0)
    axes.axhline(task.solved_reward, color=ORANGE, ls="--", lw=1, label="solved")
    axes.legend(frameon=False)
    axes.set(ylabel=f"mean test return on {task.id}", title=title)
    return figure


def shown(value: Value) -> str:
    """Format a value with a sensible number of digits."""
    if value is None or isinstance(value, str):
        return value or "-"
    if isinstance(value, int) or abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.3g}"


def with_spread(row: Row, name: str) -> str:
    """Format a value, with its standard deviation if the row has it.

    The standard deviation of NAME or NAME_mean is NAME_std.
    """
    spread = row.get(name.removesuffix("_mean") + "_std")
    return shown(row.get(name)) + ("" if spread is None else f" ± {shown(spread)}")


def heading(name: str) -> str:
    """Return the name of a column in words."""
    return name.removesuffix("_mean").replace("_", " ")


def table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return the formatted rows; standard deviations join their means."""
    names = dict.fromkeys(name for row in rows for name in row if not name.endswith("_std"))
    return pd.DataFrame({heading(n): [with_spread(row, n) for row in rows] for n in names})
