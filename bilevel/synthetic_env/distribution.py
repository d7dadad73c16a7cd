"""NES's search distribution over SEs."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from bilevel.synthetic_env.architecture import SE
from bilevel.synthetic_env.coordinates import Coordinates, Theta


@dataclass(frozen=True)
class SEDistribution:
    """N(mean, diag(std_dev^2)) over SEs: what NES moves, and what its members are drawn from.

    `average` is a moving average of past means, or the mean itself: the steps of NES are noisy, and
    what they have in common is better than any one of them (Polyak and Juditsky, 1992).
    """

    coordinates: Coordinates
    mean: Theta  # (D,)
    std_dev: Theta  # (D,)
    average: Theta  # (D,)

    @property
    def centre(self) -> SE:
        """The unperturbed SE, at the average."""
        return self.at(self.average)

    def moved(self, step: Theta, averaging: float) -> Self:
        """With `step` (D,) added to the mean, and the old average, times `averaging`, kept."""
        mean = self.mean + step
        kept = np.float32(averaging)
        return replace(self, mean=mean, average=kept * self.average + (1 - kept) * mean)

    def placed(self, theta: Theta) -> Self:
        """With the mean at theta (D,), and nothing to average yet."""
        return replace(self, mean=theta, average=theta)

    def at(self, theta: Theta) -> SE:
        """The SE at theta (D,)."""
        return SE(self.coordinates.architecture, self.coordinates.psi(theta))

    def noise(self, seed: int) -> Theta:
        """Standard normal z (D,), the same for the same seed everywhere."""
        return np.random.default_rng(seed).standard_normal(self.mean.size, np.float32)

    def perturbed(self, seed: int, sign: int) -> SE:
        """The SE at mean + sign * std_dev * z; eps of the paper is std_dev * z."""
        return self.at(self.mean + np.float32(sign) * self.std_dev * self.noise(seed))

    def random(self, seed: int) -> SE:
        """A random initialisation."""
        return self.at(self.coordinates.initialize(np.random.default_rng(seed)))
