"""Report of an evaluation of many agents: statistics and a table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationResult, comparable
from cluster.session.terminal import count


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


def groups_of(
    results: Mapping[tuple[str, str], Sequence[EvaluationResult]], solved_reward: float
) -> list[Group]:
    """A group for each source and kind of agent, in this order, of results that are compared."""
    levelled = iter(comparable([one for group in results.values() for one in group]))
    return [
        Group(source, agent, solved_reward, tuple(islice(levelled, len(group))))
        for (source, agent), group in results.items()
    ]


def as_json(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """The summaries, one dictionary per group."""
    return [{"source": g.source, "agent": g.agent, **g.summary()} for g in groups]


def as_table(groups: Sequence[Group]) -> list[str]:
    """The summaries as lines of text, of 80 columns if the labels are short, and how many agents
    have diverged if any has."""
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
    for group in groups:
        diverged = sum(not result.finite for result in group.results)
        if diverged:
            trained = count(len(group.results), f"{group.agent} agent")
            rows.append(
                f"{diverged} of {trained} on {group.source} diverged: the lowest score each"
            )
    return rows
