"""Records of generations."""

import math
from dataclasses import dataclass, replace
from typing import Self


@dataclass(frozen=True)
class GenerationRecord:
    """Aggregated results of one generation.

    Scores are mean returns on the real task. `score_*`, `train_*` and `solved_fraction` belong to
    the agents trained on the unperturbed SE. The caller measures the last three fields and adds
    them by `timed`.
    """

    generation: int  #: from 0
    attempt: int  #: number of restarts so far
    score_mean: float
    score_std: float
    score_best: float
    perturbed_score_mean: float  #: of the agents trained on perturbed SEs
    train_steps_mean: float  #: environment steps on the SE
    train_episodes_mean: float
    solved_fraction: float
    non_finite: int  #: evaluations of the generation that diverged
    real_env_steps: int  #: real steps so far: tests and the scale of observations
    cost: float  #: core seconds so far, estimated (`core_seconds`), of all evaluations
    psi_norm: float
    update_norm: float
    evaluation_seconds: float = 0.0  #: of all evaluations, on one core
    env_steps_per_second: float = 0.0  #: of training, on one core
    generation_seconds: float = 0.0
    core_utilisation: float = 0.0  #: share of the cores' time that was spent in evaluations
    finished: float = 0.0  #: unix time, seconds

    @property
    def episode_length(self) -> float:
        """Mean steps of a training episode on the unperturbed SE; NaN if all agents diverged in
        their first episode."""
        episodes = self.train_episodes_mean
        return self.train_steps_mean / episodes if episodes else math.nan

    def __str__(self) -> str:
        """Return a line of fixed width."""
        return (
            f"generation {self.generation:3d}  score {self.score_mean:7.1f} ± {self.score_std:5.1f}"
            f"  train steps {self.train_steps_mean:5.0f}"
        )

    def timed(self, seconds: float, cores: int, finished: float) -> Self:
        """Add measurements: the generation took `seconds` on `cores` cores, and ended at the unix
        time `finished`."""
        used = self.evaluation_seconds / max(seconds * cores, 1e-9)
        return replace(self, generation_seconds=seconds, core_utilisation=used, finished=finished)
