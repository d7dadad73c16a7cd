"""An NES run in this process, what its SE is worth, and what several runs have cost an SE."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from bilevel.evaluation import evaluate, train_and_test
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.nes.algorithm import EvaluateAll
from bilevel.nes.confirmation import FINAL_AGENTS
from bilevel.nes.requests import fresh_agent
from bilevel.seeds import Purpose
from bilevel.tasks import Task


def run_nes(
    task: Task, hp: Hyperparameters, seed: int, evaluate_all: EvaluateAll | None = None
) -> dict[str, Any]:
    """Run NES until an SE is confirmed or the generations are over; ten fresh agents of the paper's
    full ranges score its SE. `evaluate_all` makes the evaluations, by default one by one."""
    state = NES(task, hp, seed).run(
        evaluate_all or (lambda ses, requests: [evaluate(task, ses, r) for r in requests])
    )
    scores = []
    for agent in range(FINAL_AGENTS):
        trial, drawn = fresh_agent(hp.agents, "all", seed, Purpose.FINAL, agent)
        scores.append(train_and_test(task, state.best.se, drawn, trial).score)
    return {
        "seed": seed,
        "confirmed": state.confirmed,
        "core_seconds": round(state.cost, 1),
        "generations": state.generation,
        "score": round(float(np.mean(scores)), 1),
        "solved": bool(np.mean(scores) >= task.solved_reward),
    }


def core_seconds_per_se(runs: Sequence[dict[str, Any]], counted: str = "confirmed") -> float:
    """Core seconds of all runs over the number of those that are `counted`, `confirmed` or
    `solved`: what an SE costs, the failures paid for. Infinite if there is none."""
    found = sum(run[counted] for run in runs)
    return sum(run["core_seconds"] for run in runs) / found if found else math.inf
