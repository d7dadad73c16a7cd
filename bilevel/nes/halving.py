"""Successive halving (Jamieson and Talwalkar, 2016) between candidates."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self


@dataclass(frozen=True)
class Round:
    """A round: how many candidates enter it, and how many agents evaluate each of them."""

    candidates: int  #: at most
    agents: int  #: in addition to those of earlier rounds


@dataclass(frozen=True)
class Halving:
    """Successive halving between candidates, which are integers."""

    left: tuple[int, ...]  #: remaining candidates, best first
    rounds: tuple[Round, ...]
    round: int = 0

    @classmethod
    def between(cls, candidates: Sequence[int], rounds: Sequence[Round]) -> Self:
        """Start with the first round."""
        return cls(tuple(candidates)[: rounds[0].candidates], tuple(rounds))

    @property
    def agents(self) -> int:
        """Number of agents that evaluate each candidate in this round."""
        return self.rounds[self.round].agents

    @property
    def winner(self) -> int | None:
        """The last candidate; None while several are left."""
        return self.left[0] if len(self.left) == 1 else None

    @property
    def evaluations(self) -> int:
        """Number of evaluations in this round and the following ones."""
        sizes = (min(len(self.left), r.candidates) for r in self.rounds[self.round :])
        agents = (r.agents for r in self.rounds[self.round :])
        return sum(n * m for n, m in zip(sizes, agents, strict=True) if n > 1)

    def after(self, order: Sequence[int]) -> Self:
        """Return the next round; `order` ranks the positions in `left`, best first."""
        following = self.round + 1
        size = self.rounds[following].candidates if following < len(self.rounds) else 1
        return replace(self, left=tuple(self.left[i] for i in order[:size]), round=following)
