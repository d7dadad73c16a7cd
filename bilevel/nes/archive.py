"""The archive of a run's best SEs.

A run may degrade after it has solved the task, so that the best SEs are kept beside the current
one; several of them, because a score is a sample of agents and the highest one a lucky sample: the
end of a run retests them all.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from bilevel.nes.records import GenerationRecord
from bilevel.synthetic_env.coordinates import Theta

#: Number of SEs that the archive keeps.
FINALISTS = 4


@dataclass(frozen=True)
class Finalist:
    """One of the best SEs of a run, with its scores in its generation."""

    theta: Theta  # (D,)
    generation: int
    score_mean: float
    perturbed_score_mean: float

    @classmethod
    def of(cls, theta: Theta, record: GenerationRecord) -> Self:
        """The unperturbed SE of a generation."""
        return cls(theta, record.generation, record.score_mean, record.perturbed_score_mean)

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key, higher is better; ties go to the SE whose perturbations score higher."""
        return self.score_mean, self.perturbed_score_mean


def admitted(finalists: Sequence[Finalist], new: Finalist) -> tuple[Finalist, ...]:
    """The best FINALISTS of these and the new one, best first; ties go to earlier generations."""
    ranked = sorted([*finalists, new], key=lambda finalist: finalist.rank, reverse=True)
    return tuple(ranked[:FINALISTS])
