"""Confirmation with fresh agents that the current SE solves the task.

The scores that suggest a solved task are the highest of many samples, so they are often high by
chance. Therefore fresh agents are trained on the current SE by the stopping rule, in rounds; an SE
that fails a round is not tried in the next. The agents are drawn from the paper's full ranges and
narrowed (`bilevel.agents.variation`), since most of the time of agents of all sizes goes into a few
large ones. Where `vary_agent` is "no", they have the recipe's hyperparameters.

An SE must serve whoever tries it next. That is a few agents, of which a single bad one can spoil
the mean. So what is confirmed is not the mean score of all agents, which can be known ever better,
but that the mean of FINAL_AGENTS agents solves the task nearly always.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

#: Share of the agents that have been trained by the end of each round.
ROUNDS = (1 / 8, 1 / 2, 1)
#: Number of fresh agents that score an SE at a run's end, and whose mean must therefore solve the
#: task; as many as the paper trains on each of its SEs.
FINAL_AGENTS = 10
#: Share of such means that must solve it at first, how much less must after each confirmation that
#: failed, and the least: a run must end.
REQUIRED_SHARE, DECREASE, LEAST_SHARE = 0.95, 0.01, 0.9
#: Number of such means that are drawn, with replacement, from all agents (bootstrap).
BOOTSTRAP_SAMPLES = 20_000


@dataclass(frozen=True)
class Confirmation:
    """A confirmation with `agents` agents, after `refuted` others that failed, and the scores of
    the rounds so far."""

    agents: int
    refuted: int = 0
    scores: tuple[tuple[float, ...], ...] = ()

    @property
    def _ends(self) -> list[int]:
        """Numbers of agents by the end of each round; few agents make fewer rounds."""
        return sorted({max(round(share * self.agents), 1) for share in ROUNDS})

    @property
    def coming(self) -> range:
        """Numbers (from 0, over all rounds) of the agents that are trained next."""
        ends = [0, *self._ends]
        return range(ends[len(self.scores)], ends[len(self.scores) + 1])

    def after(self, scores: Sequence[float]) -> Self:
        """The confirmation after the agents `coming` have got these scores."""
        return replace(self, scores=(*self.scores, tuple(scores)))

    @property
    def all_scores(self) -> NDArray[np.float64]:
        """Scores (n,) of the agents so far."""
        return np.array([score for scores in self.scores for score in scores])

    @property
    def required(self) -> float:
        """Share of the means that must solve the task."""
        return max(REQUIRED_SHARE - DECREASE * self.refuted, LEAST_SHARE)

    def verdict(self, solved_reward: float) -> bool | None:
        """Whether the SE is confirmed. None: train more.

        After each round the mean score of all agents must reach the solved reward; after the last
        one, also the means of most samples of FINAL_AGENTS of them.
        """
        scores = self.all_scores
        if scores.mean() < solved_reward:
            return False
        if len(self.scores) < len(self._ends):
            return None
        return solving_share(scores, solved_reward) >= self.required


def solving_share(scores: NDArray[np.float64], solved_reward: float) -> float:
    """Share of the bootstrap samples of FINAL_AGENTS agents, from agents with these scores (n,),
    whose mean score reaches the solved reward."""
    samples = np.random.default_rng(0).choice(scores, (BOOTSTRAP_SAMPLES, FINAL_AGENTS))
    return float((samples.mean(axis=1) >= solved_reward).mean())
