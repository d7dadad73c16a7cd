"""The objective of a search: the expected core time until a confirmed SE, from any seed.

A configuration runs NES with one seed after another until its budget of core time is spent. Its
objective is the *expected running time* of Hansen et al. (2016, "COCO: performance assessment",
arXiv:1605.03560) with the target "an SE that fresh agents have confirmed": the core time of all
runs, successful or not, divided by the number of successes. A single lucky seed has little effect,
because promoted configurations run further seeds. An unfinished run counts as at most half a
success, in proportion to its progress towards the solved reward, so that configurations without an
SE can be ranked.

Core time is estimated from counts (`core_seconds`), which makes the objective reproducible. The
paper's authors maximised the summed scores of three runs, which ignore time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from bilevel.nes import NESState
from bilevel.tasks import Task

#: Number of last generations whose scores measure progress.
_RECENT = 4
#: Successes that an unfinished run counts for at full progress, and at least. The minimum keeps the
#: objective finite.
_FULL_PROGRESS, _MINIMUM = 0.5, 0.005


@dataclass(frozen=True)
class Tally:
    """Costs and successes of the NES runs of a configuration."""

    cost: float  # estimated core seconds of all runs
    runs: int
    confirmed: int  # runs that ended with a confirmed SE
    #: Progress of the unfinished last run towards the solved reward, on [0, 1]; 0 without one.
    progress: float

    @classmethod
    def of(cls, states: Sequence[NESState], task: Task) -> Self:
        """Count the runs of a configuration, of which the last may be unfinished."""
        return cls(
            cost=sum(state.cost for state in states),
            runs=len(states),
            confirmed=sum(state.confirmed for state in states),
            progress=_progress(states[-1], task) if states and not states[-1].finished else 0.0,
        )

    @property
    def objective(self) -> float:
        """Expected core seconds to a confirmed SE."""
        return self.cost / (self.confirmed + max(_FULL_PROGRESS * self.progress, _MINIMUM))

    @property
    def info(self) -> dict[str, Any]:
        """Rounded values for a result's `info`."""
        return {
            "core_seconds": round(self.cost, 2),
            "runs": self.runs,
            "confirmed": self.confirmed,
            "progress": round(self.progress, 3),
        }

    @staticmethod
    def describe(info: Mapping[str, Any]) -> str:
        """Format `info` for the terminal."""
        cost, confirmed = info["core_seconds"], info["confirmed"]
        if not confirmed:
            return f"none confirmed in {cost:.0f} core s, scores {info['progress']:.0%} of the way"
        ses = "1 SE" if confirmed == 1 else f"{confirmed} SEs"
        return f"{ses} in {cost:.0f} core s"


def _progress(state: NESState, task: Task) -> float:
    """Return the position of the mean of the last scores between the task's worst score and its
    solved reward."""
    records = state.records[state.attempt_start :][-_RECENT:]
    if not records:
        return 0.0
    score = float(np.mean([record.score_mean for record in records]))
    worst, solved = task.worst_score, task.solved_reward
    return float(np.clip((score - worst) / (solved - worst), 0.0, 1.0))
