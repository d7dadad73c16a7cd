"""The scale of a task's observations."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

#: Range of an observation, relative to its mean, up to which it counts as constant.
_CONSTANT = 1e-6


@dataclass(frozen=True)
class ObservationScale:
    """Mean and standard deviation (S,) of a task's observations under random actions."""

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    real_env_steps: int  # steps that measured them

    @classmethod
    def of(cls, observations: NDArray[np.float32]) -> Self:
        """Return the scale of observations (n, S); a constant one has standard deviation 1."""
        seen = observations.astype(np.float64)
        mean, deviation = seen.mean(axis=0), seen.std(axis=0)
        # Rounding errors: the computed deviation of a constant is not always 0.
        constant = np.ptp(seen, axis=0) <= _CONSTANT * np.maximum(np.abs(mean), 1.0)
        deviation = np.where(constant, 1.0, deviation)
        return cls(mean.astype(np.float32), deviation.astype(np.float32), len(seen))
