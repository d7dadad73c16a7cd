"""Report of an evaluation of many agents: statistics, a table, a violin plot."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationResult
from bilevel.tasks import Task

_COLOURS = ("#2a6fbb", "#d9822b", "#3d9970", "#8a8f98", "#b04a8b")


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
    def train_steps(self) -> NDArray[np.float64]:
        """Train steps (n,) of the agents."""
        return np.array([result.train_steps for result in self.results], np.float64)

    @property
    def train_episodes(self) -> NDArray[np.float64]:
        """Train episodes (n,) of the agents."""
        return np.array([result.train_episodes for result in self.results], np.float64)

    def summary(self) -> dict[str, float]:
        """Mean, standard deviation and quartiles of test returns, train steps and train episodes;
        the fraction of agents that solve the task; the number of diverged agents."""
        values: dict[str, float] = {"agents": float(len(self.results))}
        for name in ("test_returns", "train_steps", "train_episodes"):
            array = getattr(self, name)
            low, middle, high = np.quantile(array, (0.25, 0.5, 0.75))
            values |= {
                f"{name}_mean": float(array.mean()),
                f"{name}_std": float(array.std()),
                f"{name}_q1": float(low),
                f"{name}_median": float(middle),
                f"{name}_q3": float(high),
            }
        scores = np.array([result.score for result in self.results])
        values["solved_fraction"] = float((scores >= self.solved_reward).mean())
        values["non_finite"] = float(sum(not result.finite for result in self.results))
        return values


def as_json(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """The summaries, one dictionary per group."""
    return [{"source": g.source, "agent": g.agent, **g.summary()} for g in groups]


def as_table(groups: Sequence[Group]) -> list[str]:
    """The summaries as lines of text."""
    width = max(len(group.source) for group in groups)
    rows = [
        f"{'trained on':{width}}  {'agent':12}  agents   test return          quartiles"
        "             solved   train steps         episodes"
    ]
    for group in groups:
        s = group.summary()
        rows.append(
            f"{group.source:{width}}  {group.agent:12}  {s['agents']:6.0f}  "
            f"{s['test_returns_mean']:7.1f} ± {s['test_returns_std']:6.1f}  "
            f"{s['test_returns_q1']:6.1f} {s['test_returns_median']:6.1f} "
            f"{s['test_returns_q3']:6.1f}   {s['solved_fraction']:6.0%}  "
            f"{s['train_steps_mean']:7.0f} ± {s['train_steps_std']:6.0f}  "
            f"{s['train_episodes_mean']:5.0f} ± {s['train_episodes_std']:4.0f}"
        )
    return rows


def violins(groups: Sequence[Group], task: Task) -> Figure:
    """Violin plots of every group's test returns and, below, train steps (as in the paper's
    figures on robustness and transfer)."""
    figure = Figure(figsize=(max(5.0, 1.9 * len(groups) + 1.5), 6), layout="constrained")
    returns, steps = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.4])
    kinds = sorted({group.agent for group in groups})
    for place, group in enumerate(groups):
        colour = _COLOURS[kinds.index(group.agent) % len(_COLOURS)]
        for axes, values in ((returns, group.test_returns), (steps, group.train_steps)):
            # A violin of equal values has no width to draw.
            if np.ptp(values) > 0:
                body = axes.violinplot(values, [place], widths=0.85, showextrema=False)["bodies"][0]
                body.set(facecolor=colour, alpha=0.45)
            axes.boxplot(
                values,
                positions=[place],
                widths=0.12,
                showfliers=False,
                medianprops={"color": "black"},
            )
            axes.scatter([place], [values.mean()], marker="D", s=22, color=colour, zorder=3)
        s = group.summary()
        _above(returns, place, f"{s['test_returns_mean']:.1f}")
        _above(steps, place, f"{s['train_steps_mean']:.0f} ± {s['train_steps_std']:.0f}")
    returns.axhline(task.solved_reward, color="#d9822b", ls="--", lw=1, label="solved")
    returns.set_ylabel(f"test return on {task.id}")
    returns.legend(frameon=False, fontsize="small", loc="lower left")
    steps.set_ylabel("train steps")
    steps.set_ylim(bottom=0)
    labels = [f"{group.agent}\non {group.source}" for group in groups]
    steps.set_xticks(range(len(groups)), labels, fontsize="small")
    for axes in (returns, steps):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _above(axes: Axes, place: int, text: str) -> None:
    axes.annotate(
        text,
        (place, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
        fontsize="small",
    )
