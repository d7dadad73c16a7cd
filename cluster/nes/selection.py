"""The end of a run: choose its best SE, score it with fresh agents, and save it."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, EvaluationResult, scores_of
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes.halving import Halving, Round
from bilevel.nes.requests import fresh_agent, with_patience
from bilevel.seeds import Purpose
from bilevel.synthetic_env import StoredSE, save_se
from bilevel.tasks import Task
from cluster.ray.pool import EvaluationPool
from cluster.storage.run_folder import BEST_FILE, Final, add_final, finals

#: Root of fresh seeds: the run's seed, and optionally a generation.
Seed = tuple[int, ...]


@dataclass(frozen=True)
class FinalScore:
    """Scores (n,) and train steps (n,) of fresh agents trained on one SE."""

    scores: NDArray[np.float64]
    train_steps: NDArray[np.int64]
    solved_reward: float

    def metrics(self) -> dict[str, float]:
        """Return metrics for MLflow."""
        return {
            "final_score_mean": float(self.scores.mean()),
            "final_score_std": float(self.scores.std()),
            "final_train_steps_mean": float(self.train_steps.mean()),
            "final_solved_fraction": float((self.scores >= self.solved_reward).mean()),
        }

    def __str__(self) -> str:
        solving = int((self.scores >= self.solved_reward).sum())
        verdict = "solved" if self.scores.mean() >= self.solved_reward else "not solved"
        return (
            f"{self.scores.size} fresh agents trained on the best SE score "
            f"{self.scores.mean():.1f} ± {self.scores.std():.1f} on the real task "
            f"({verdict}: {solving} of {self.scores.size} agents reach {self.solved_reward:g}), "
            f"after {self.train_steps.mean():.0f} steps"
        )


@dataclass(frozen=True)
class Contender:
    """A candidate for the best SE, with the hyperparameters that it was learned with."""

    se: StoredSE
    hp: Hyperparameters


#: Choice between a few SEs: one round.
RETEST = (Round(100, 32),)
#: Maximum number of contenders of a `race`.
RACERS = 16


def race(final_agents: int) -> tuple[Round, ...]:
    """Return the rounds of a choice between many SEs, most of which scored high by chance.

    The effort grows with the number of agents that will score the winner. For 10 of them, SEs that
    reach the last round are evaluated by 96 agents.
    """
    first = math.ceil(0.8 * final_agents)
    return Round(RACERS, first), Round(6, 3 * first), Round(2, 8 * first)


def agents_needed(contenders: int, rounds: Sequence[Round]) -> int:
    """Return the number of agents that a choice trains."""
    return Halving.between(range(contenders), rounds).evaluations


def choose_best(
    task: Task,
    contenders: Sequence[Contender],
    seed: Seed,
    pool: EvaluationPool,
    on_test: Callable[[], None] = lambda: None,
    rounds: Sequence[Round] = RETEST,
    is_late: Callable[[], bool] = lambda: False,
) -> Contender:
    """Return the contender whose agents score highest, by successive halving.

    `contenders` are ordered, best first, and break ties after fewer diverged agents and fewer train
    steps. In each round, all remaining contenders get the same additional fresh agents. No round
    but the first starts when `is_late` returns True.
    """
    results: list[list[EvaluationResult]] = [[] for _ in contenders]
    halving = Halving.between(range(len(contenders)), rounds)
    while halving.winner is None and not (halving.round and is_late()):
        for i in halving.left:
            vary, first = contenders[i].hp.vary_agent, len(results[i])
            numbers = range(first, first + halving.agents)
            agents = _fresh_agents(contenders[i].hp, vary, numbers, Purpose.RETEST, seed)
            tested = pool.run(task, contenders[i].se.se, agents, lambda result: on_test())
            results[i] += sorted(tested, key=attrgetter("index"))
        halving = halving.after(_ranking([results[i] for i in halving.left]))
    return contenders[halving.left[0]]


def _ranking(results: Sequence[Sequence[EvaluationResult]]) -> list[int]:
    """Return the order of SEs with these results: by score, diverged agents, then train steps."""
    scores = scores_of([result for of_se in results for result in of_se])
    means = scores.reshape(len(results), -1).mean(axis=1)
    diverged = [sum(not result.finite for result in of_se) for of_se in results]
    steps = [float(np.mean([result.train_steps for result in of_se])) for of_se in results]
    order: list[int] = np.lexsort((steps, diverged, -means)).tolist()  # the last key comes first
    return order


def evaluate_holdout(
    task: Task, contender: Contender, agents: int, seed: Seed, pool: EvaluationPool
) -> FinalScore:
    """Score an SE with fresh agents, whose seeds no choice has used.

    The agents train until the stopping rule ends their training. If agents vary, they are drawn
    from the paper's full ranges.
    """
    hp = contender.hp
    vary = "no" if hp.vary_agent == "no" else "all"
    impatient = replace(hp, nes=replace(hp.nes, patient_episodes=0))
    requests = _fresh_agents(impatient, vary, range(agents), Purpose.FINAL, seed)
    results = sorted(pool.run(task, contender.se.se, requests), key=attrgetter("index"))
    steps = np.array([result.train_steps for result in results])
    return FinalScore(scores_of(results), steps, task.solved_reward)


def _fresh_agents(
    hp: Hyperparameters, vary: str, numbers: range, purpose: Purpose, seed: Seed
) -> list[EvaluationRequest]:
    """Return fresh agents; if NES has patient agents, every second one is patient."""
    root, *when = seed
    requests = []
    for index, number in enumerate(numbers):
        trial_seed, agent = fresh_agent(hp.agents, vary, root, purpose, *when, number)
        agent = with_patience(agent, hp.nes, number)
        requests.append(EvaluationRequest(index, trial_seed, agent))
    return requests


def export_best(
    se: StoredSE, score: FinalScore, folder: Path, step: int, learned: int, tests: int
) -> tuple[Path, int]:
    """Save an SE with its final score in a run's folder.

    `step` is the number of generations, or of a study's results. `learned` are the real steps of
    the run, or of all runs of a study, and `tests` those of this choice and final score. Return the
    file's path and the total of real steps, including the tests of earlier ends of the run.
    Raises StorageFailure.
    """
    path, end = folder / BEST_FILE, Final(step, time.time(), score.metrics(), tests)
    earlier = [final for final in finals(folder) if not end.repeats(final)]
    real_steps = learned + tests + sum(final.real_env_steps for final in earlier)
    save_se(replace(se, info={**se.info, "real_env_steps": real_steps, **end.metrics}), path)
    add_final(folder, end)
    return path, real_steps
