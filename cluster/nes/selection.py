"""The end of a run: retest its best SEs, score the winner with fresh agents, and save it."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, EvaluationResult, scores_of
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes.requests import Trial, as_turn, fresh_agent
from bilevel.seeds import Purpose
from bilevel.synthetic_env import StoredSE, save_se
from bilevel.tasks import Task
from cluster.ray.pool import EvaluationPool
from cluster.storage.run_folder import BEST_FILE, Final, add_final, finals

#: Root of fresh seeds: the run's seed, and optionally the time in the run.
Seed = tuple[int, ...]


@dataclass(frozen=True)
class FinalScore:
    """Scores (n,) and train steps (n,) of fresh agents trained on one SE."""

    scores: NDArray[np.float64]
    train_steps: NDArray[np.int64]
    solved_reward: float

    @property
    def solved(self) -> bool:
        """Whether the agents solve the task on average."""
        return bool(self.scores.mean() >= self.solved_reward)

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
        verdict = "solved" if self.solved else "not solved"
        return (
            f"{self.scores.size} fresh agents trained on the best SE score "
            f"{self.scores.mean():.1f} ± {self.scores.std():.1f} on the real task "
            f"({verdict}: {solved} of {self.scores.size} agents reach {self.solved_reward:g}), "
            f"after {self.train_steps.mean():.0f} steps"
        )


@dataclass(frozen=True)
class Contender:
    """A candidate for the best SE, with the hyperparameters that it was learned with."""

    se: StoredSE
    hp: Hyperparameters


@dataclass(frozen=True)
class Round:
    """A round of successive halving between SEs."""

    contenders: int  # maximum number
    agents: int  # trained on each contender by the end of the round


#: Choice between a few SEs: one round.
RETEST = (Round(100, 32),)
#: Most contenders of a `race`.
RACERS = 16


def race(final_agents: int) -> tuple[Round, ...]:
    """The choice between many SEs, most of which scored high by chance. Its effort grows with the
    number of agents that score the winner: of 10, it trains 8, 32 and 96 on those that remain."""
    fewest = math.ceil(0.8 * final_agents)
    return Round(RACERS, fewest), Round(6, 4 * fewest), Round(2, 12 * fewest)


def in_time(rounds: Iterable[Round], is_over: Callable[[], bool]) -> Iterator[Round]:
    """The first round, and the next ones as long as time is left when they begin."""
    for number, one in enumerate(rounds):
        if number > 0 and is_over():
            return
        yield one


def agents_needed(contenders: int, rounds: Sequence[Round]) -> int:
    """Number of agents that a choice trains; a single contender needs none."""
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
    rounds: Iterable[Round] = RETEST,
) -> Contender:
    """The contender whose agents score highest; ties go to fewer diverged agents, to fewer train
    steps, then to the order of `contenders`, best first. Each round trains more fresh agents, the
    same for all, on the remaining contenders and keeps the best for the next round (successive
    halving)."""
    if len(contenders) == 1:
        return contenders[0]
    left, found = list(contenders), list[list[EvaluationResult]]([] for _ in contenders)
    for one in rounds:
        left, found = left[: one.contenders], found[: one.contenders]
        for contender, results in zip(left, found, strict=True):
            more = range(len(results), one.agents)
            drawn = _agents(contender.hp, contender.hp.vary_agent, more, Purpose.RETEST, seed)
            results += _tested(task, contender.se, drawn, pool, on_test)
        scores = scores_of([result for results in found for result in results])
        means = scores.reshape(len(found), -1).mean(axis=1)
        diverged = [float(sum(not result.finite for result in results)) for results in found]
        steps = [float(np.mean([result.train_steps for result in results])) for results in found]
        order = np.lexsort((steps, diverged, -means))  # stable; the last key comes first
        left, found = [left[i] for i in order], [found[i] for i in order]
    return left[0]


def evaluate_holdout(
    task: Task, contender: Contender, agents: int, seed: Seed, pool: EvaluationPool
) -> FinalScore:
    """Score the SE with `agents` fresh agents, whose seeds took part in no choice.

    The agents train by the stopping rule; if agents vary, they are drawn from the paper's full
    ranges.
    """
    hp = contender.hp
    vary = "no" if hp.vary_agent == "no" else "all"
    impatient = replace(hp, nes=replace(hp.nes, patient_episodes=0))
    drawn = _agents(impatient, vary, range(agents), Purpose.FINAL, seed)
    results = _tested(task, contender.se, drawn, pool)
    return FinalScore(
        scores_of(results),
        np.array([result.train_steps for result in results]),
        task.solved_reward,
    )


def _agents(
    hp: Hyperparameters, vary: str, numbers: range, purpose: Purpose, seed: Seed
) -> list[Trial]:
    """The fresh agents with these numbers; if NES has patient agents, every second one is."""
    root, *when = seed
    drawn = []
    for number in numbers:
        word, agent = fresh_agent(hp.agents, vary, root, purpose, *when, number)
        drawn.append((word, as_turn(agent, hp.nes, number)))
    return drawn


def _tested(
    task: Task,
    se: StoredSE,
    agents: Sequence[Trial],
    pool: EvaluationPool,
    on_test: Callable[[], None] = lambda: None,
) -> list[EvaluationResult]:
    """The results of these agents, in their order."""
    requests = [EvaluationRequest(i, *trial) for i, trial in enumerate(agents)]
    results = pool.run(task, se.se, requests, lambda result: on_test())
    return sorted(results, key=lambda result: result.index)


def export_best(
    se: StoredSE, score: FinalScore, folder: Path, step: int, learned: int, tests: int
) -> tuple[Path, int]:
    """Save the SE with its final score in a run's folder; return the file's path and all steps on
    the real task that it has taken.

    `step` is the number of generations, or of a study's results; `learned` counts the real steps of
    the generations, of a study those of all its runs, and `tests` those of retests and last tests;
    to these come the tests of earlier ends. Raises StorageFailure.
    """
    path, end = folder / BEST_FILE, Final(step, time.time(), score.metrics(), tests)
    earlier = [one for one in finals(folder) if not end.repeats(one)]
    real_steps = learned + tests + sum(one.real_env_steps for one in earlier)
    save_se(replace(se, info={**se.info, "real_env_steps": real_steps, **end.metrics}), path)
    add_final(folder, end)
    return path, real_steps
