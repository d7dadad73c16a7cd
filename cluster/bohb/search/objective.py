"""What a search minimises: the core time that a configuration takes to learn an SE, from any seed.

A configuration runs NES with one seed after the other until its budget of core time is spent. Its
objective is the *expected running time* of Hansen et al. (2016, "COCO: performance assessment",
arXiv:1605.03560) for the target "an SE that fresh agents have confirmed": the core time of all
runs, successful or not, divided by the number of successes. One lucky seed wins little, because a
configuration that is promoted goes on with other seeds. A run that is not over counts as half of a
success at most, by how near its scores have come to the solved reward; so configurations that have
no SE yet can be told apart.

Core time is estimated from counts (`bilevel.cost`), which makes the objective reproducible. The
paper's authors summed the scores of three runs; that neither counts time nor tells a run that is
solved from one that hovers below.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from bilevel.nes import NESState

#: Generations over whose scores the progress of a run that is not over is averaged.
_RECENT = 4
#: What a run that has nearly solved the task counts of a success; the least that counts, so that
#: the objective is finite.
_NEARLY, _LEAST = 0.5, 0.005


@dataclass(frozen=True)
class Tally:
    """What the NES runs of a configuration have come to."""

    cost: float  # core seconds of all runs, estimated
    runs: int
    confirmed: int  # runs that ended with a confirmed SE
    #: How near the scores of the last run have come to the solved reward, on [0, 1], while it is
    #: not over; else 0.
    progress: float

    @classmethod
    def of(cls, states: Sequence[NESState]) -> Self:
        """Count the runs of a configuration, of which the last may not be over."""
        return cls(
            cost=sum(state.cost for state in states),
            runs=len(states),
            confirmed=sum(state.confirmed for state in states),
            progress=_progress(states[-1]) if states and not states[-1].finished else 0.0,
        )

    @property
    def objective(self) -> float:
        """Expected core seconds to a confirmed SE."""
        return self.cost / (self.confirmed + max(_NEARLY * self.progress, _LEAST))

    @property
    def info(self) -> dict[str, Any]:
        """As a result's additional values, rounded for people."""
        return {
            "core_seconds": round(self.cost, 2),
            "runs": self.runs,
            "confirmed": self.confirmed,
            "progress": round(self.progress, 3),
        }

    @staticmethod
    def describe(info: Mapping[str, Any]) -> str:
        """`info` in words: what an SE costs, or how near the first one is."""
        cost, confirmed = info["core_seconds"], info["confirmed"]
        if not confirmed:
            return f"none confirmed in {cost:.0f} core s, scores {info['progress']:.0%} of the way"
        ses = "1 SE" if confirmed == 1 else f"{confirmed} SEs"
        return f"{ses} in {cost:.0f} core s"


def _progress(state: NESState) -> float:
    """How near the last scores of a run have come to the solved reward, on [0, 1]; 0 before its
    first generation."""
    records = state.records[state.attempt_began :][-_RECENT:]
    if not records:
        return 0.0
    score = float(np.mean([record.score_mean for record in records]))
    worst, solved = state.task.worst_score, state.task.solved_reward
    return float(np.clip((score - worst) / (solved - worst), 0.0, 1.0))
