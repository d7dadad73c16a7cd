"""Confirmation by fresh agents that the current SE solves the task.

The scores that suggest a solved task are the highest of many samples, so they are often high by
chance. Therefore fresh agents train on the current SE by the stopping rule, in rounds, and an SE
that fails a round is rejected. The agents are drawn from the paper's full ranges and narrowed
(`bilevel.agents.variation`), unless `vary_agent` is "no".

Users will train a few agents on an SE, of which a single bad one can spoil the mean. Therefore the
mean score of FINAL_AGENTS further agents must solve the task nearly always. To save real steps,
each confirming agent has a few test episodes only, so that chance in tests is separated from the
differences between agents (analysis of variance with a random effect of the agent).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

#: Share of the agents that have been trained by the end of each round.
_ROUNDS = (1 / 8, 1 / 2, 1)
#: Minimum number of test episodes of an agent.
CONFIRMING_EPISODES = 2
#: Number of fresh agents that score an SE at the end of a run, and of their test episodes, as in
#: the paper.
FINAL_AGENTS, FINAL_EPISODES = 10, 10
#: Probability that their mean solves the task, its decrease per failed confirmation, and its
#: minimum. It decreases because a run must end.
REQUIRED, DECREASE, MINIMUM = 0.95, 0.01, 0.9


@dataclass(frozen=True)
class Confirming:
    """Phase of a run: a confirmation with `agents` agents, after `refuted` failed ones."""

    agents: int
    refuted: int = 0
    rounds: int = 0  #: so far
    returns: tuple[tuple[float, ...], ...] = ()  #: test returns of each agent so far
    phase: Literal["confirming"] = "confirming"

    @property
    def _ends(self) -> list[int]:
        """Cumulative numbers of agents per round; few agents make fewer rounds."""
        return sorted({max(round(share * self.agents), 1) for share in _ROUNDS})

    @property
    def coming(self) -> range:
        """Numbers of the next round's agents, counted from 0 over all rounds."""
        ends = [0, *self._ends]
        return range(ends[self.rounds], ends[self.rounds + 1])

    def after(self, returns: Sequence[Sequence[float]]) -> Self:
        """Return the confirmation with the test returns of each of the agents `coming`."""
        new = tuple(tuple(episodes) for episodes in returns)
        return replace(self, rounds=self.rounds + 1, returns=(*self.returns, *new))

    @property
    def required(self) -> float:
        """Probability with which the mean of the final agents must solve the task."""
        return max(REQUIRED - DECREASE * self.refuted, MINIMUM)

    def verdict(self, solved_reward: float) -> bool | None:
        """Return whether the SE is confirmed, or None if more agents are needed.

        The mean score of all agents must reach the solved reward after each round, and the mean of
        FINAL_AGENTS further agents with the required probability after the last one.
        """
        returns = np.array(self.returns)
        if returns.mean() < solved_reward:
            return False
        if self.rounds < len(self._ends):
            return None
        return solving_probability(returns, solved_reward) >= self.required


def solving_probability(returns: NDArray[np.float64], solved_reward: float) -> float:
    """Return the probability that the mean of FINAL_AGENTS further agents solves the task, given
    test returns (n, E) of n agents, under normal distributions of agents and episodes."""
    n, episodes = returns.shape
    scores = returns.mean(axis=1)
    of_scores = scores.var(ddof=1) if n > 1 else 0.0
    within = returns.var(axis=1, ddof=1).mean() if episodes > 1 else 0.0
    between = max(of_scores - within / episodes, 0.0)
    final = (between + within / FINAL_EPISODES) / FINAL_AGENTS
    deviation = math.sqrt(final + of_scores / n)
    margin = float(scores.mean() - solved_reward)
    return NormalDist().cdf(margin / deviation) if deviation else float(margin >= 0)
