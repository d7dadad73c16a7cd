"""Confirmation with fresh agents that the current SE solves the task.

The scores that suggest a solved task are the highest of many samples, so they are often high by
chance. Therefore fresh agents are trained on the current SE by the stopping rule, in several rounds;
an SE that fails a round is not tried in the next. Most rounds train agents from the paper's full
ranges that are narrowed (`bilevel.agents.variation`) and therefore cheap; agents of all sizes, most
of whose time goes into a few large ones, come last.

An SE must serve whoever tries it next. That is a few agents, of which a single bad one can spoil the
mean. So what is confirmed is not the mean score of all agents, which can be known ever better, but
that JUDGES more of them will surely solve the task.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

#: Agents of each round, as multiples of `nes.confirming_agents`.
ROUNDS = (2, 6, 8, 1)
#: Number of agents whose mean score must solve the task: as many as score an SE at a run's end, and
#: as the paper trains on each of its SEs.
JUDGES = 10


@dataclass(frozen=True)
class Confirmation:
    """A confirmation with `agents` agents of all sizes, and the scores of the rounds so far."""

    agents: int
    scores: tuple[tuple[float, ...], ...] = ()

    @property
    def coming(self) -> range:
        """Numbers (from 0, over all rounds) of the agents that are trained next."""
        past = sum(ROUNDS[: len(self.scores)])
        return range(past * self.agents, (past + ROUNDS[len(self.scores)]) * self.agents)

    @property
    def narrowed(self) -> bool:
        """Whether the agents that are trained next are narrowed."""
        return len(self.scores) < len(ROUNDS) - 1

    @property
    def total(self) -> int:
        """Number of agents of all rounds."""
        return sum(ROUNDS) * self.agents

    def after(self, scores: Sequence[float]) -> Self:
        """The confirmation after the agents `coming` have got these scores."""
        return replace(self, scores=(*self.scores, tuple(scores)))

    @property
    def of_narrowed(self) -> NDArray[np.float64]:
        """Scores (n,) of the narrowed agents."""
        return np.array([score for scores in self.scores[: len(ROUNDS) - 1] for score in scores])

    @property
    def of_all_sizes(self) -> NDArray[np.float64]:
        """Scores (n,) of the agents of all sizes; none before the last round."""
        return np.array([score for scores in self.scores[len(ROUNDS) - 1 :] for score in scores])

    def verdict(self, solved_reward: float) -> bool | None:
        """Whether the SE is confirmed. None: train more.

        The mean score of the first round must reach the solved reward; then the mean of JUDGES more
        agents must reach it surely, as the narrowed agents so far predict and, at last, as those of
        all sizes do.
        """
        if len(self.scores) == 1:
            return None if self.of_narrowed.mean() >= solved_reward else False
        if len(self.scores) < len(ROUNDS):
            return None if _surely(self.of_narrowed) >= solved_reward else False
        return _surely(self.of_all_sizes) >= solved_reward


def _surely(scores: NDArray[np.float64]) -> float:
    """Lower bound of the mean score of JUDGES more agents (97.5 %, for normal scores)."""
    deviation = scores.std(ddof=min(scores.size - 1, 1))
    error = deviation * math.sqrt(1 / JUDGES + 1 / scores.size)
    return float(scores.mean() - 2 * error)
