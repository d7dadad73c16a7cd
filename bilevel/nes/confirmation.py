"""Whether the SE of a run that seems to be solved teaches agents that nothing was chosen by.

Scores that end a run were lucky more often than not: they are the highest of many samples. So
fresh agents are trained on the current SE, drawn from the whole of the paper's ranges and trained
by the stopping rule. A quarter of them comes first, and the others only if these solve the task.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np


@dataclass(frozen=True)
class Confirmation:
    """A confirmation under way: scores of the first of so many agents."""

    agents: int
    scores: tuple[float, ...] = ()

    @property
    def coming(self) -> range:
        """Numbers of the agents that are trained next."""
        few = max(self.agents // 4, 1)
        return range(few, self.agents) if self.scores else range(few)

    def after(self, scores: Sequence[float]) -> Self:
        """With the scores of those."""
        return replace(self, scores=(*self.scores, *scores))

    def verdict(self, solved_reward: float) -> bool | None:
        """Whether the SE is confirmed: its agents solve the task by twice the standard error of
        their mean, so that others are likely to do so too. None: more agents are needed."""
        scores = np.array(self.scores)
        if scores.mean() < solved_reward:
            return False
        if scores.size < self.agents:
            return None
        error = scores.std(ddof=min(scores.size - 1, 1)) / math.sqrt(scores.size)
        return bool(scores.mean() - 2 * error >= solved_reward)
