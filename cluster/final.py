"""The end of a run: its best SEs retested, the winner scored anew and handed over."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import fitness, worth_of
from bilevel.synthetic_env import StoredSE, save_se
from bilevel.tasks import Task
from cluster.pool import EvaluationPool
from cluster.run_folder import Final, add_final
from search_spaces import draw_agent

#: Name the fresh seeds apart from all others that a run derives.
_RETEST, _FINAL = 0x5245_5445, 0x4649_4E41

#: What fresh seeds are derived from: the run's seed, and when in the run.
Seed = tuple[int, ...]

#: Fresh agents that decide between the contenders for the best SE.
RETESTS = 32

#: Of a run's folder and of its artifacts.
BEST_FILE, LAST_FILE = "best_se.safetensors", "last_se.safetensors"


@dataclass(frozen=True)
class FinalScore:
    """Scores (n,) and train steps (n,) of fresh agents trained on one SE."""

    scores: NDArray[np.float64]
    train_steps: NDArray[np.int64]
    solved_reward: float

    def metrics(self) -> dict[str, float]:
        """As metrics for MLflow."""
        return {
            "final_score_mean": float(self.scores.mean()),
            "final_score_std": float(self.scores.std()),
            "final_train_steps_mean": float(self.train_steps.mean()),
            "final_solved_fraction": float((self.scores >= self.solved_reward).mean()),
        }

    def __str__(self) -> str:
        solved = int((self.scores >= self.solved_reward).sum())
        verdict = "solved" if self.scores.mean() >= self.solved_reward else "not solved"
        return (
            f"{self.scores.size} fresh agents trained on the best SE score "
            f"{self.scores.mean():.1f} ± {self.scores.std():.1f} on the real task "
            f"({verdict}: {self.solved_reward:g} is; {solved} of {self.scores.size} agents do), "
            f"after {self.train_steps.mean():.0f} steps"
        )


@dataclass(frozen=True)
class Contender:
    """An SE that may be the best, and the agent it was made for."""

    se: StoredSE
    hp: Hyperparameters


def choose_best(
    task: Task,
    contenders: Sequence[Contender],
    seed: Seed,
    pool: EvaluationPool,
    on_test: Callable[[], None] = lambda: None,
) -> Contender:
    """Train `RETESTS` fresh agents on each SE; the best by `worth_of`, among equals the
    one that took fewer steps. Contenders come best first, so one alone needs no test."""
    if len(contenders) == 1:
        return contenders[0]

    def rank(contender: Contender) -> tuple[float, float, float]:
        found = _fresh_agents(task, contender, RETESTS, (*seed, _RETEST), pool, on_test)
        fit = fitness(task, contender.hp.nes, found.scores, found.train_steps)
        worth = worth_of(found.scores.mean(), fit.mean(), task.solved_reward)
        return *worth, -found.train_steps.mean()

    return max(contenders, key=rank)


def score_anew(
    task: Task, contender: Contender, agents: int, seed: Seed, pool: EvaluationPool
) -> FinalScore:
    """Train `agents` fresh agents on the SE, with seeds nothing was chosen by."""
    return _fresh_agents(task, contender, agents, (*seed, _FINAL), pool)


def _fresh_agents(
    task: Task,
    contender: Contender,
    agents: int,
    seed: Seed,
    pool: EvaluationPool,
    on_test: Callable[[], None] = lambda: None,
) -> FinalScore:
    se, hp = contender.se, contender.hp
    words = [int(word) for word in np.random.SeedSequence(seed).generate_state(agents, np.uint64)]
    requests = [
        EvaluationRequest(i, word, draw_agent(hp.agents, hp.vary_agent, word))
        for i, word in enumerate(words)
    ]
    results = pool.run(task, se.architecture, se.psi, requests, lambda result: on_test())
    results = sorted(results, key=lambda result: result.index)
    return FinalScore(
        np.array([r.score if np.isfinite(r.score) else task.worst_score for r in results]),
        np.array([result.train_steps for result in results]),
        task.solved_reward,
    )


def hand_over(se: StoredSE, score: FinalScore, folder: Path, step: int) -> Path:
    """Put the SE, with its final score, into a run's folder; returns its file.

    `step` is how far the run has come: generations, or results of a study. Raises
    StorageFailure.
    """
    path = folder / BEST_FILE
    save_se(replace(se, info={**se.info, **score.metrics()}), path)
    add_final(folder, Final(step, time.time(), score.metrics()))
    return path
