"""The end of a run: the best SE scored anew with fresh seeds, and handed over."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest
from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.synthetic_env import StoredSE, save_se
from bilevel.tasks import Task
from cluster.pool import EvaluationPool
from cluster.tracking import Tracker
from search_spaces import vary_agent

#: Names the fresh seeds apart from all others that a run derives.
_FINAL = 0x46494E41

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


def score_anew(
    task: Task,
    se: StoredSE,
    agent: DDQNHyperparameters,
    agents: int,
    seed: int,
    pool: EvaluationPool,
    vary: bool = False,
) -> FinalScore:
    """Train `agents` fresh agents on the SE, with seeds no generation has used."""
    words = np.random.SeedSequence([seed, _FINAL]).generate_state(agents, np.uint64)
    requests = [
        EvaluationRequest(i, int(word), vary_agent(agent, int(word)) if vary else agent)
        for i, word in enumerate(words)
    ]
    results = sorted(
        pool.run(task, se.architecture, se.psi, requests), key=lambda result: result.index
    )
    return FinalScore(
        np.array([result.score for result in results]),
        np.array([result.train_steps for result in results]),
        task.solved_reward,
    )


def hand_over(
    se: StoredSE, score: FinalScore, folder: Path, tracker: Tracker, run_id: str
) -> tuple[Path, str]:
    """Save the SE with its final score, log and register it; returns its file and
    its address in the model registry."""
    path = folder / BEST_FILE
    save_se(replace(se, info={**se.info, **score.metrics()}), path)
    tracker.log_file(run_id, path)
    tracker.log_metrics(run_id, score.metrics(), 0)
    return path, tracker.register_se(
        run_id, path, se.task_id, {k: f"{v:.6g}" for k, v in score.metrics().items()}
    )
