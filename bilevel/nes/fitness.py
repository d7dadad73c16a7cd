"""What NES maximises."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import NESHyperparameters
from bilevel.tasks import Task


def fitness(
    task: Task,
    hp: NESHyperparameters,
    scores: NDArray[np.float64],
    train_steps: NDArray[np.int64],
) -> NDArray[np.float64]:
    """What NES maximises, of the shape of both: the scores, less a share of what each is
    above the task's worst for every 1000 of the train steps.

    A share, not an amount: agents that fail soon shall not be fitter than those that need
    long to learn something.
    """
    left = np.maximum(1 - hp.step_price * train_steps / 1000, 0.0)
    fit: NDArray[np.float64] = task.worst_score + (scores - task.worst_score) * left
    return fit


def judged(
    task: Task, hp: NESHyperparameters, results: Sequence[EvaluationResult]
) -> tuple[list[EvaluationResult], NDArray[np.float64], NDArray[np.float64]]:
    """Results, given in any order, in that of their requests; their scores (n,), of which
    those that are not finite are the task's worst; their fitness (n,)."""
    ordered = sorted(results, key=lambda result: result.index)
    scores = np.array([r.score for r in ordered])
    scores = np.where(np.isfinite(scores), scores, task.worst_score)
    steps = np.array([r.train_steps for r in ordered], np.int64)
    return ordered, scores, fitness(task, hp, scores, steps)


def worth_of(score: float, fitness: float, solved_reward: float) -> tuple[float, float]:
    """What SEs are ordered by, from the mean score and fitness of their agents: of those
    that solve the task the fittest is best, of the others the one that scores highest.

    Without a step price that is the order of the scores. With one, no SE is better for
    teaching faster before it teaches well.
    """
    return min(score, solved_reward), fitness
