"""An NES run in this process, and the cost of an SE over several runs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from bilevel.evaluation import evaluate, train_and_test
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.nes.confirmation import FINAL_AGENTS
from bilevel.nes.requests import fresh_agent
from bilevel.seeds import Purpose
from bilevel.tasks import Task


def run_nes(task: Task, hp: Hyperparameters, seed: int) -> dict[str, Any]:
    """Run NES to its end, and score its SE with fresh agents of the paper's full ranges."""
    nes = NES(task, hp, seed)
    state = nes.run(lambda ses, requests: [evaluate(task, ses, request) for request in requests])
    scores = []
    for agent in range(FINAL_AGENTS):
        trial, drawn = fresh_agent(hp.agents, "all", seed, Purpose.FINAL, agent)
        scores.append(train_and_test(task, nes.best(state).se, drawn, trial).score)
    return {
        "seed": seed,
        "confirmed": state.confirmed,
        "core_seconds": round(state.cost, 1),
        "generations": state.generation,
        "score": round(float(np.mean(scores)), 1),
        "solved": bool(np.mean(scores) >= task.solved_reward),
    }


def core_seconds_per_se(runs: Sequence[dict[str, Any]], success: str = "confirmed") -> float:
    """Return the core seconds of all runs per successful run; infinite if there is none.

    `success` is "confirmed" or "solved".
    """
    found = sum(run[success] for run in runs)
    return sum(run["core_seconds"] for run in runs) / found if found else math.inf
