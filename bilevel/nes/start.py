"""The choice of a start among random SEs, by successive halving.

Agents learn nothing on most random SEs. All candidates of a round get the same agents and random
numbers, so that scores are comparable. Agents train briefly, because a better start shows long
before they are done. If all candidates score the same, as on tasks with a rare reward, others are
drawn.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from bilevel.evaluation import EvaluationResult, scores_of
from bilevel.nes.halving import Halving, Round

#: Agents per candidate, and share of all candidates, of each round.
_ROUNDS = ((1, 1.0), (4, 1 / 8), (8, 1 / 32))
#: Maximum number of draws.
_DRAWS = 20


@dataclass(frozen=True)
class ChoosingStart:
    """Phase of a run: a round of the choice. Candidates are initialisation seeds."""

    halving: Halving
    draws: int = 1  #: of candidates, so far
    phase: Literal["choosing a start"] = "choosing a start"

    @classmethod
    def between(cls, seeds: Sequence[int], draws: int = 1) -> Self:
        """Start with all candidates."""
        rounds = [Round(math.ceil(len(seeds) * share), agents) for agents, share in _ROUNDS]
        return cls(Halving.between(seeds, rounds), draws)

    def redraws(self, results: Sequence[EvaluationResult]) -> bool:
        """Return whether this round's results require other candidates."""
        equal = len(results) > 1 and np.ptp(scores_of(results)) == 0
        return bool(equal) and self.halving.round == 0 and self.draws < _DRAWS

    def after(self, results: Sequence[EvaluationResult]) -> Self:
        """Return the next round, given this round's results in the order of their requests."""
        scores = scores_of(results).reshape(len(self.halving.left), -1).mean(axis=1)
        order = np.argsort(-scores, kind="stable").tolist()
        return replace(self, halving=self.halving.after(order))
