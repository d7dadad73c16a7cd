"""Confirmation with fresh agents that the current SE solves the task.

The scores that suggest a solved task are the highest of many samples, so they are often high by
chance. Therefore fresh agents, drawn from the paper's full ranges, are trained on the current SE by
the stopping rule. A quarter of them comes first; the others follow only if these solve the task.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np


@dataclass(frozen=True)
class Confirmation:
    """A confirmation with `agents` agents, and the scores of the first of them."""

    agents: int
    scores: tuple[float, ...] = ()

    @property
    def coming(self) -> range:
        """Numbers (from 0) of the agents that are trained next."""
        few = max(self.agents // 4, 1)
        return range(few, self.agents) if self.scores else range(few)

    def after(self, scores: Sequence[float]) -> Self:
        """The confirmation after the agents `coming` have got these scores."""
        return replace(self, scores=(*self.scores, *scores))

    def verdict(self, solved_reward: float) -> bool | None:
        """Whether the SE is confirmed: the mean score exceeds the solved reward by twice its
        standard error, so that other agents are likely to solve the task too. None: train more."""
        scores = np.array(self.scores)
        if scores.mean() < solved_reward:
            return False
        if scores.size < self.agents:
            return None
        error = scores.std(ddof=min(scores.size - 1, 1)) / math.sqrt(scores.size)
        return bool(scores.mean() - 2 * error >= solved_reward)
