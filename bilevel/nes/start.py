"""The choice of a start among random SEs, by successive halving.

Agents learn nothing on most random SEs. All candidates of a round get the same agents and random
numbers, so that scores are comparable. Agents train briefly, because a better start shows long
before they are done.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from bilevel.evaluation import EvaluationRequest, EvaluationResult, Initialized, scores_of
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.hyperparameters.validation import within_range
from bilevel.nes.halving import Halving, Round

#: Maximum number of training episodes in the choice, or twice the agent's `init_episodes`, in which
#: it does not learn, if that is more.
EPISODES = 40

#: Agents per candidate, and share of all candidates, of each round.
_ROUNDS = ((1, 1.0), (4, 1 / 8), (8, 1 / 32))


@dataclass(frozen=True)
class ChoosingStart:
    """Phase of a run: a round of the choice. Candidates are initialisation seeds."""

    halving: Halving
    phase: Literal["choosing a start"] = "choosing a start"

    @classmethod
    def between(cls, seeds: Sequence[int]) -> Self:
        """Start with all candidates."""
        rounds = [Round(math.ceil(len(seeds) * share), agents) for agents, share in _ROUNDS]
        return cls(Halving.between(seeds, rounds))

    def requests(
        self, trials: Sequence[tuple[int, AgentHyperparameters]]
    ) -> list[EvaluationRequest]:
        """Return this round's requests: every candidate with each of the trials (seed, agent)."""
        pairs = itertools.product(self.halving.left, trials)
        return [
            EvaluationRequest(index, seed, _brief(agent), Initialized(candidate))
            for index, (candidate, (seed, agent)) in enumerate(pairs)
        ]

    def after(self, results: Sequence[EvaluationResult]) -> Self:
        """Return the next round, given this round's results in the order of their requests."""
        scores = scores_of(results).reshape(len(self.halving.left), -1).mean(axis=1)
        order = np.argsort(-scores, kind="stable").tolist()
        return replace(self, halving=self.halving.after(order))


def _brief(agent: AgentHyperparameters) -> AgentHyperparameters:
    """Shorten the agent's training."""
    episodes = max(EPISODES, 2 * agent.init_episodes)
    episodes = within_range(type(agent), "max_episodes", episodes)
    return replace(agent, max_episodes=min(agent.max_episodes, episodes))
