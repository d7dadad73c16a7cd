"""Records of generations, and the best SEs of a run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from bilevel.evaluation import EvaluationResult
from bilevel.synthetic_env.coordinates import Theta
from bilevel.tasks import Task

if TYPE_CHECKING:
    from bilevel.nes.state import NESState


@dataclass(frozen=True)
class GenerationRecord:
    """Aggregated results of one generation.

    Scores are mean returns on the real task; `score_*`, `train_*` and `solved_fraction` are of
    the agents trained on the unperturbed SE. The last three fields are measured by the caller
    that runs the evaluations, and added by `timed`.
    """

    generation: int  # from 0
    attempt: int  # from 0; number of restarts so far
    score_mean: float
    score_std: float
    score_best: float
    perturbed_score_mean: float  # of the agents trained on perturbed SEs
    train_steps_mean: float  # environment steps on the SE
    train_episodes_mean: float
    solved_fraction: float  # of the agents trained on the unperturbed SE
    non_finite: int  # evaluations of the generation that diverged
    real_env_steps: int  # steps on the real task so far: tests, and the scale of observations
    psi_norm: float
    update_norm: float
    std_dev: float  # root mean square of this generation's sigma
    evaluation_seconds: float = 0.0  # of all evaluations, on one core
    env_steps_per_second: float = 0.0  # of training, on one core
    generation_seconds: float = 0.0
    core_utilisation: float = 0.0  # share of the cores' time that was spent in evaluations
    finished: float = 0.0  # unix time, seconds

    @classmethod
    def of(
        cls,
        task: Task,
        state: "NESState",
        results: Sequence[EvaluationResult],
        centre_agents: int,
        step: Theta,
    ) -> Self:
        """The record of `results`, in the order of their requests, and the update `step` (D,)."""
        scores = np.array([result.score for result in results])
        centre, on_centre = scores[:centre_agents], results[:centre_agents]
        seconds = sum(result.seconds for result in results)
        train_steps = sum(result.train_steps for result in results)
        return cls(
            generation=state.generation,
            attempt=state.attempt,
            score_mean=float(centre.mean()),
            score_std=float(centre.std()),
            score_best=float(centre.max()),
            perturbed_score_mean=float(scores[centre_agents:].mean()),
            train_steps_mean=float(np.mean([r.train_steps for r in on_centre])),
            train_episodes_mean=float(np.mean([r.train_episodes for r in on_centre])),
            solved_fraction=float((centre >= task.solved_reward).mean()),
            non_finite=sum(not r.finite for r in results),
            real_env_steps=state.real_env_steps,
            psi_norm=float(np.linalg.norm(state.se.centre.psi)),
            update_norm=float(np.linalg.norm(step)),
            std_dev=float(np.sqrt(np.mean(np.square(state.se.std_dev)))),
            evaluation_seconds=seconds,
            env_steps_per_second=train_steps / max(seconds, 1e-9),
        )

    def timed(self, seconds: float, cores: int, finished: float) -> Self:
        """Add the measurements: the generation took `seconds` on `cores` cores, until the unix
        time `finished`."""
        used = self.evaluation_seconds / max(seconds * cores, 1e-9)
        return replace(self, generation_seconds=seconds, core_utilisation=used, finished=finished)


#: Number of best SEs that a run keeps.
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
