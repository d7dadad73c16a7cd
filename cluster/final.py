"""The end of a run: its best SEs retested, the winner scored anew and handed over."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

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

#: Of a run's folder and of its artifacts.
BEST_FILE, LAST_FILE = "best_se.safetensors", "last_se.safetensors"


@dataclass(frozen=True)
class FinalScore:
    """Scores (n,) and train steps (n,) of fresh agents trained on one SE."""

    scores: NDArray[np.float64]
    train_steps: NDArray[np.int64]
    solved_reward: float

    def __add__(self, other: Self) -> Self:
        """Of these agents and those."""
        scores = np.concatenate([self.scores, other.scores])
        steps = np.concatenate([self.train_steps, other.train_steps])
        return replace(self, scores=scores, train_steps=steps)

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


@dataclass(frozen=True)
class Round:
    """Of a choice between SEs."""

    contenders: int  # that are in it, at most
    agents: int  # that each has been tried on by its end


#: A choice between a few: the same for all.
RETEST = (Round(100, 32),)
#: Between many, most of them there by luck.
RACE = (Round(16, 8), Round(6, 32), Round(2, 96))


def agents_needed(contenders: int, rounds: Sequence[Round]) -> int:
    """That a choice trains; one contender alone needs none."""
    if contenders == 1:
        return 0
    before = [0, *(one.agents for one in rounds)]
    return sum(
        min(contenders, one.contenders) * (one.agents - fewer)
        for one, fewer in zip(rounds, before, strict=False)
    )


def choose_best(
    task: Task,
    contenders: Sequence[Contender],
    seed: Seed,
    pool: EvaluationPool,
    on_test: Callable[[], None] = lambda: None,
    rounds: Sequence[Round] = RETEST,
) -> Contender:
    """The best by `worth_of`, among equals the one that took fewer steps; contenders come best
    first. Each round trains more fresh agents, the same for all, on those that are left, and
    keeps the best of them for the next (successive halving, Jamieson and Talwalkar, 2016)."""
    if len(contenders) == 1:
        return contenders[0]
    none = FinalScore(np.empty(0), np.empty(0, np.int64), task.solved_reward)
    tried = [(contender, none) for contender in contenders]

    def rank(one: tuple[Contender, FinalScore]) -> tuple[float, float, float]:
        contender, found = one
        fit = fitness(task, contender.hp.nes, found.scores, found.train_steps)
        worth = worth_of(found.scores.mean(), fit.mean(), task.solved_reward)
        return *worth, -found.train_steps.mean()

    def more(contender: Contender, agents: range) -> FinalScore:
        return _fresh_agents(task, contender, agents, (*seed, _RETEST), pool, on_test)

    for one in rounds:
        tried = [
            (contender, found + more(contender, range(found.scores.size, one.agents)))
            for contender, found in tried[: one.contenders]
        ]
        tried.sort(key=rank, reverse=True)
    return tried[0][0]


def score_anew(
    task: Task, contender: Contender, agents: int, seed: Seed, pool: EvaluationPool
) -> FinalScore:
    """Train `agents` fresh agents on the SE, with seeds nothing was chosen by."""
    return _fresh_agents(task, contender, range(agents), (*seed, _FINAL), pool)


def _fresh_agents(
    task: Task,
    contender: Contender,
    agents: range,
    seed: Seed,
    pool: EvaluationPool,
    on_test: Callable[[], None] = lambda: None,
) -> FinalScore:
    """The agents of these numbers."""
    se, hp = contender.se, contender.hp
    drawn = np.random.SeedSequence(seed).generate_state(agents.stop, np.uint64)
    words = [int(drawn[number]) for number in agents]
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
