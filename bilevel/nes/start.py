"""The choice of a random SE to start from, by successive halving (Jamieson and Talwalkar, 2016).

Agents learn nothing on most random SEs. The first round trains one agent on each candidate, the
second four on the best eighth, the third eight on the best thirty-second; parts of candidates count
as whole ones. The choice ends once one candidate is left: up to 8 candidates after the first round,
up to 32 after the second. All candidates of a round get the same agents and random numbers, so
that scores are comparable. They train briefly: which start is better shows long before they are
done, and the choice is a large part of a short run.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from bilevel.evaluation import EvaluationRequest, EvaluationResult, Initialized, scores_of
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.hyperparameters.validation import within_range

#: Training episodes of an agent in the choice, at most; twice its `init_episodes`, in which it does
#: not learn, if these are more.
EPISODES = 40

#: Per round: agents trained on each candidate, and the share of all candidates that take part.
ROUNDS = ((1, 1.0), (4, 1 / 8), (8, 1 / 32))


@dataclass(frozen=True)
class StartRace:
    """One round of the choice of a start, with the initialisation seeds of its candidates."""

    seeds: tuple[int, ...]
    candidates: int  # in the first round
    round: int = 0

    @classmethod
    def of(cls, seeds: Sequence[int]) -> Self:
        """The first round, with all candidates."""
        return cls(tuple(seeds), len(seeds))

    @property
    def agents(self) -> int:
        """Number of agents trained on each candidate in this round."""
        return ROUNDS[self.round][0]

    @property
    def winner(self) -> int | None:
        """The seed of the chosen start; None while several candidates are left."""
        return self.seeds[0] if len(self.seeds) == 1 else None

    @property
    def evaluations(self) -> int:
        """Number of evaluations left, in all rounds."""
        if self.winner is not None:
            return 0
        later = (self._size(number) for number in range(self.round + 1, len(ROUNDS)))
        sizes = zip((len(self.seeds), *later), ROUNDS[self.round :], strict=True)
        return sum(size * agents for size, (agents, _) in sizes if size > 1)

    def _size(self, number: int) -> int:
        """Number of candidates in round `number`; 1 after the last round."""
        if number >= len(ROUNDS):
            return 1
        return math.ceil(self.candidates * ROUNDS[number][1])

    def requests(
        self, trials: Sequence[tuple[int, AgentHyperparameters]]
    ) -> list[EvaluationRequest]:
        """Requests of this round: every candidate with each of the trials (seed, agent)."""
        brief = [(trial, _brief(agent)) for trial, agent in trials]
        pairs = [(seed, *trial) for seed in self.seeds for trial in brief]
        return [
            EvaluationRequest(index, trial, agent, Initialized(seed))
            for index, (seed, trial, agent) in enumerate(pairs)
        ]

    def after(self, results: Sequence[EvaluationResult]) -> Self:
        """The next round, given this round's results in the order of their requests."""
        scores = scores_of(results).reshape(len(self.seeds), -1)
        order = np.argsort(-scores.mean(axis=1), kind="stable")[: self._size(self.round + 1)]
        return replace(self, seeds=tuple(self.seeds[i] for i in order), round=self.round + 1)


def _brief(agent: AgentHyperparameters) -> AgentHyperparameters:
    """The agent as it trains in the choice."""
    episodes = max(EPISODES, 2 * agent.init_episodes)
    episodes = within_range(type(agent), "max_episodes", episodes)
    return replace(agent, max_episodes=min(agent.max_episodes, episodes))
