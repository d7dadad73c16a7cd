"""Step control: finer steps, and a longer memory of their average, near a good SE.

Once generations solve the task, hardly any member fails, so that the ranks of single generations
are mostly noise. Each confirmation that fails tells that the SE is good but not yet good enough.
"""

from dataclasses import dataclass

import numpy as np

from bilevel.hyperparameters import NESHyperparameters
from bilevel.synthetic_env.coordinates import Theta

#: Numbers of failed confirmations that refine the steps, and the average.
FINEST_STEP, FINEST_AVERAGE = 5, 2


@dataclass(frozen=True)
class StepControl:
    """Step and average of a run whose hyperparameters are `nes`, after `refuted` confirmations
    that failed: each makes the step `nes.refinement` times as long, and the share that a step has
    in the average as many times as large."""

    nes: NESHyperparameters
    refuted: int

    def refined(self, step: Theta) -> Theta:
        """The step (D,) to take instead of `step` (D,)."""
        return np.float32(self._after(FINEST_STEP)) * step

    @property
    def averaging(self) -> float:
        """Share of the average that stays in a generation."""
        return 1 - self._after(FINEST_AVERAGE) * (1 - self.nes.averaging)

    def _after(self, most: int) -> float:
        return float(self.nes.refinement ** min(self.refuted, most))
