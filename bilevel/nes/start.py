"""The choice of a random SE to start from, by successive halving (Jamieson and Talwalkar, 2016).

Most random SEs teach nothing. Each of the candidates is tried once; an eighth of them four times
more; of these a quarter, at least one, eight times; the best of these is the start. In a round
all candidates are tried with the same agents and random numbers, so that scores order SEs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from bilevel.evaluation import EvaluationRequest, EvaluationResult, Initialized
from bilevel.hyperparameters import AgentHyperparameters

#: Agents that a round tries each candidate on, and the share of the first round's candidates
#: that are in it.
ROUNDS = ((1, 1.0), (4, 1 / 8), (8, 1 / 32))


@dataclass(frozen=True)
class StartRace:
    """The candidates, by the seeds of their initialisation, that are in a round."""

    seeds: tuple[int, ...]
    candidates: int  # in the first round
    round: int = 0

    @classmethod
    def of(cls, seeds: Sequence[int]) -> Self:
        """Before the first round."""
        return cls(tuple(seeds), len(seeds))

    @property
    def agents(self) -> int:
        """Agents that each candidate is tried on in this round."""
        return ROUNDS[self.round][0]

    @property
    def winner(self) -> int | None:
        """The seed of the chosen start, None while several are left."""
        return self.seeds[0] if len(self.seeds) == 1 else None

    @property
    def evaluations(self) -> int:
        """That are still to come, in all rounds."""
        if self.winner is not None:
            return 0
        later = (self._size(number) for number in range(self.round + 1, len(ROUNDS)))
        sizes = zip((len(self.seeds), *later), ROUNDS[self.round :], strict=True)
        return sum(size * agents for size, (agents, _) in sizes if size > 1)

    def _size(self, number: int) -> int:
        """Candidates in the round of that number; 1 after the last."""
        if number >= len(ROUNDS):
            return 1
        return math.ceil(self.candidates * ROUNDS[number][1])

    def requests(
        self, trials: Sequence[tuple[int, AgentHyperparameters]]
    ) -> list[EvaluationRequest]:
        """Of this round: every candidate on each of the trials (seed, agent)."""
        pairs = [(seed, *trial) for seed in self.seeds for trial in trials]
        return [
            EvaluationRequest(index, trial, agent, Initialized(seed))
            for index, (seed, trial, agent) in enumerate(pairs)
        ]

    def after(self, results: Sequence[EvaluationResult]) -> Self:
        """The next round, from this one's results in the order of their requests."""
        scores = np.array([result.score for result in results]).reshape(len(self.seeds), -1)
        order = np.argsort(-scores.mean(axis=1), kind="stable")[: self._size(self.round + 1)]
        return replace(self, seeds=tuple(self.seeds[i] for i in order), round=self.round + 1)
