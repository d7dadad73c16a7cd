"""What the evaluations of one generation tell."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import NESHyperparameters
from bilevel.nes.fitness import judged
from bilevel.nes.state import Finalist, GenerationRecord
from bilevel.nes.updates import MemberScores
from bilevel.tasks import Task


@dataclass(frozen=True)
class Generation:
    """Results in the order of their requests: a row for psi itself, for psi + eps, and with
    mirrored sampling for psi - eps; n agents in each."""

    task: Task
    results: list[EvaluationResult]
    scores: NDArray[np.float64]  # (rows, n)
    fitness: NDArray[np.float64]  # (rows, n)

    @classmethod
    def of(cls, task: Task, hp: NESHyperparameters, results: Sequence[EvaluationResult]) -> Self:
        """From results in any order."""
        ordered, scores, fit = judged(task, hp, results)
        shape = -1, hp.population_size
        return cls(task, ordered, scores.reshape(shape), fit.reshape(shape))

    @property
    def members(self) -> MemberScores:
        """The fitness, as the updates read it."""
        centre, plus, *minus = self.fitness
        return MemberScores(centre, plus, *(minus or [None]))

    @cached_property
    def retention(self) -> float:
        """The share of psi's score, above the task's worst, that its perturbations keep;
        1 if there is nothing to keep."""
        worst = self.task.worst_score
        centre, perturbed = self.scores[0].mean() - worst, self.scores[1:].mean() - worst
        return float(np.clip(perturbed / centre, 0.0, 1.0)) if centre > 0 else 1.0

    def finalist(self, psi: NDArray[np.float32], generation: int) -> Finalist:
        """psi with what it scored."""
        centre = self.scores[0]
        known = centre.size > 1  # a single value tells nothing of its error
        return Finalist(
            psi=psi,
            generation=generation,
            score_mean=float(centre.mean()),
            fitness_mean=float(self.fitness[0].mean()),
            perturbed_score_mean=float(self.scores[1:].mean()),
            score_error=float(centre.std(ddof=1) / centre.size**0.5) if known else math.inf,
        )

    def record(
        self,
        generation: int,
        psi_norm: float,
        update_norm: float,
        std_dev: float,
        generation_seconds: float,
        cores: int,
        finished: float,
    ) -> GenerationRecord:
        """For the report; the evaluations took so many seconds on so many cores."""
        scores, on_psi = self.scores[0], self.results[: self.scores.shape[1]]
        kernel_seconds = max(sum(r.seconds for r in self.results), 1e-9)
        return GenerationRecord(
            generation=generation,
            score_mean=float(scores.mean()),
            score_std=float(scores.std()),
            score_best=float(scores.max()),
            perturbed_score_mean=float(self.scores[1:].mean()),
            fitness_mean=float(self.fitness[0].mean()),
            train_steps_mean=float(np.mean([r.train_steps for r in on_psi])),
            train_episodes_mean=float(np.mean([r.train_episodes for r in on_psi])),
            solved_fraction=float((scores >= self.task.solved_reward).mean()),
            non_finite=sum(not (r.finite and math.isfinite(r.score)) for r in self.results),
            psi_norm=psi_norm,
            update_norm=update_norm,
            std_dev=std_dev,
            retention=self.retention,
            env_steps_per_second=sum(r.train_steps for r in self.results) / kernel_seconds,
            generation_seconds=generation_seconds,
            core_utilisation=kernel_seconds / max(generation_seconds * cores, 1e-9),
            finished=finished,
        )
