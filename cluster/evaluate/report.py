"""Report of an evaluation of many agents: statistics, a table, a picture."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import t as student_t

from bilevel.evaluation import EvaluationResult
from bilevel.tasks import Task

_COLOURS = ("#2a6fbb", "#d9822b", "#3d9970", "#8a8f98", "#b04a8b")

#: Number of agents from which a violin shows their distribution; of fewer it would invent one.
VIOLIN_FROM = 20


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
        """Scores (n,) of the agents: the mean return of each."""
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
        values["solved_fraction"] = float((self.scores >= self.solved_reward).mean())
        values["non_finite"] = float(sum(not result.finite for result in self.results))
        return values


def as_json(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """The summaries, one dictionary per group."""
    return [{"source": g.source, "agent": g.agent, **g.summary()} for g in groups]


def as_table(groups: Sequence[Group]) -> list[str]:
    """The summaries as lines of text, of 80 columns if the labels are short."""
    source = max(len("trained on"), *(len(group.source) for group in groups))
    agent = max(len("agent"), *(len(group.agent) for group in groups))
    rows = [
        f"{'trained on':{source}}  {'agent':{agent}}  {'n':>3}  {'test return':>15}  "
        f"{'solved':>6}  {'train steps':>13}  {'episodes':>9}"
    ]
    for group in groups:
        s = group.summary()
        rows.append(
            f"{group.source:{source}}  {group.agent:{agent}}  {s['agents']:3.0f}  "
            f"{s['test_returns_mean']:7.1f} ± {s['test_returns_std']:5.1f}  "
            f"{s['solved_fraction']:6.0%}  "
            f"{s['train_steps_mean']:6.0f} ± {s['train_steps_std']:4.0f}  "
            f"{s['train_episodes_mean']:3.0f} ± {s['train_episodes_std']:3.0f}"
        )
    return rows


def picture(groups: Sequence[Group], task: Task, title: str) -> Figure:
    """Plot every agent's score and, below, its train steps, by group: a point an agent, the mean
    with its 95 % interval and, where there are VIOLIN_FROM agents or more, a violin (as in the
    paper's figures on robustness and transfer)."""
    figure = Figure(figsize=(max(5.0, 1.9 * len(groups) + 1.5), 6), layout="constrained")
    scores, steps = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.4])
    kinds = sorted({group.agent for group in groups})
    for place, group in enumerate(groups):
        colour = _COLOURS[kinds.index(group.agent) % len(_COLOURS)]
        for axes, values in ((scores, group.scores), (steps, group.train_steps)):
            _column(axes, place, values, colour)
            _above(
                axes, place, f"{values.mean():.1f}" if axes is scores else f"{values.mean():.0f}"
            )
    scores.axhline(task.solved_reward, color="#d9822b", ls="--", lw=1, label="solved")
    scores.set_ylabel(f"mean test return on {task.id}")
    figure.supxlabel("a point an agent; black: their mean and its 95 % interval", fontsize="small")
    scores.legend(frameon=False, fontsize="small", loc="lower left")
    scores.set_title(title, pad=18, wrap=True)  # above the means
    steps.set_ylabel("train steps")
    steps.set_ylim(bottom=0)
    labels = [f"{g.agent}\non {g.source}\nn = {len(g.results)}" for g in groups]
    steps.set_xticks(range(len(groups)), labels, fontsize="small")
    steps.set_xlim(-0.6, len(groups) - 0.4)
    for axes in (scores, steps):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _column(axes: Axes, place: int, values: NDArray[np.float64], colour: str) -> None:
    """The values of one group at that place on the x-axis."""
    if len(values) >= VIOLIN_FROM and np.ptp(values) > 0:
        parts: Any = axes.violinplot(values, [place], widths=0.85, showextrema=False)
        parts["bodies"][0].set(facecolor=colour, alpha=0.3)
    # Spread evenly in the order of the agents, so that the picture is always the same.
    beside = np.linspace(-0.18, 0.18, len(values)) if len(values) > 1 else np.zeros(1)
    axes.scatter(place + beside, values, s=14, color=colour, alpha=0.6, lw=0)
    error = 0.0
    if len(values) > 1:
        quantile = float(student_t.ppf(0.975, len(values) - 1))
        error = quantile * float(values.std(ddof=1)) / math.sqrt(len(values))
    axes.errorbar([place], [values.mean()], yerr=error, fmt="D", ms=5, color="black", capsize=4)


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
