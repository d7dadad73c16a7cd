"""Records of generations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from bilevel.evaluation import EvaluationResult, scores_of


@dataclass(frozen=True)
class GenerationRecord:
    """Aggregated results of one generation. `score_*`, `train_*` and `solved_fraction` belong to
    the agents trained on the unperturbed SE; `timed` adds the last three fields."""

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
    cost: float  #: core seconds so far, estimated as in `NESState`
    psi_norm: float
    update_norm: float
    evaluation_seconds: float = 0.0  #: of all evaluations, on one core
    env_steps_per_second: float = 0.0  #: of training, on one core
    generation_seconds: float = 0.0
    core_utilisation: float = 0.0  #: share of the cores' time that was spent in evaluations
    finished: float = 0.0  #: unix time, seconds

    @classmethod
    def of(
        cls,
        results: Sequence[EvaluationResult],
        centre_agents: int,
        solved_reward: float,
        **values: Any,
    ) -> Self:
        """Aggregate results; the first `centre_agents` belong to the unperturbed SE."""
        scores = scores_of(results)
        centre, on_centre = scores[:centre_agents], results[:centre_agents]
        seconds = sum(result.seconds for result in results)
        return cls(
            score_mean=float(centre.mean()),
            score_std=float(centre.std()),
            score_best=float(centre.max()),
            perturbed_score_mean=float(scores[centre_agents:].mean()),
            train_steps_mean=float(np.mean([result.train_steps for result in on_centre])),
            train_episodes_mean=float(np.mean([result.train_episodes for result in on_centre])),
            solved_fraction=float((centre >= solved_reward).mean()),
            non_finite=sum(not result.finite for result in results),
            evaluation_seconds=seconds,
            env_steps_per_second=sum(result.train_steps for result in results) / max(seconds, 1e-9),
            **values,
        )

    def __str__(self) -> str:
        """Return a line of fixed width."""
        return (
            f"generation {self.generation:3d}  score {self.score_mean:7.1f} ± {self.score_std:5.1f}"
            f"  train steps {self.train_steps_mean:5.0f}"
        )

    def timed(self, seconds: float, cores: int, finished: float) -> Self:
        """Add measured times: of the generation on `cores` cores, and the unix time of its end."""
        used = self.evaluation_seconds / max(seconds * cores, 1e-9)
        return replace(self, generation_seconds=seconds, core_utilisation=used, finished=finished)
