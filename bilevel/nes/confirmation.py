"""Confirmation by fresh agents that the current SE solves the task.

The scores that suggest a solved task are the highest of many samples, so they are often high by
chance. Therefore fresh agents train on the current SE by the stopping rule, in rounds, and an SE
that fails a round is rejected. The agents are drawn from the paper's full ranges and narrowed
(`bilevel.agents.variation`), unless `vary_agent` is "no".

Users will train a few agents on an SE, of which a single bad one can spoil the mean. Therefore the
mean score of FINAL_AGENTS agents must solve the task nearly always.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

#: Share of the agents that have been trained by the end of each round.
_ROUNDS = (1 / 8, 1 / 2, 1)
#: Number of fresh agents that score an SE at the end of a run, as in the paper.
FINAL_AGENTS = 10
#: Share of their means that must solve the task, its decrease per failed confirmation, and its
#: minimum. It decreases because a run must end.
REQUIRED_SHARE, DECREASE, MIN_SHARE = 0.95, 0.01, 0.9
#: Number of bootstrap samples of FINAL_AGENTS agents.
_BOOTSTRAP_SAMPLES = 20_000


@dataclass(frozen=True)
class Confirming:
    """Phase of a run: a confirmation with `agents` agents, after `refuted` failed ones."""

    agents: int
    refuted: int = 0
    scores: tuple[tuple[float, ...], ...] = ()  #: of each round so far
    phase: Literal["confirming"] = "confirming"

    @property
    def _ends(self) -> list[int]:
        """Cumulative numbers of agents per round; few agents make fewer rounds."""
        return sorted({max(round(share * self.agents), 1) for share in _ROUNDS})

    @property
    def coming(self) -> range:
        """Numbers of the next round's agents, counted from 0 over all rounds."""
        ends = [0, *self._ends]
        return range(ends[len(self.scores)], ends[len(self.scores) + 1])

    def after(self, scores: Sequence[float]) -> Self:
        """Return the confirmation with the scores of the agents `coming`."""
        return replace(self, scores=(*self.scores, tuple(scores)))

    @property
    def all_scores(self) -> NDArray[np.float64]:
        """Scores (n,) of the agents so far."""
        return np.array([score for scores in self.scores for score in scores])

    @property
    def required(self) -> float:
        """Share of the means that must solve the task."""
        return max(REQUIRED_SHARE - DECREASE * self.refuted, MIN_SHARE)

    def verdict(self, solved_reward: float) -> bool | None:
        """Return whether the SE is confirmed, or None if more agents are needed.

        The mean score of all agents must reach the solved reward after each round, and the means of
        most samples of FINAL_AGENTS agents after the last one.
        """
        scores = self.all_scores
        if scores.mean() < solved_reward:
            return False
        if len(self.scores) < len(self._ends):
            return None
        return solving_share(scores, solved_reward) >= self.required


def solving_share(scores: NDArray[np.float64], solved_reward: float) -> float:
    """Return the share of bootstrap samples of FINAL_AGENTS scores whose mean solves the task."""
    samples = np.random.default_rng(0).choice(scores, (_BOOTSTRAP_SAMPLES, FINAL_AGENTS))
    return float((samples.mean(axis=1) >= solved_reward).mean())
