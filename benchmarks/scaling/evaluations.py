"""Evaluations with their steps and their seconds of processor time.

Processor time is what an evaluation takes on a core of its own, also when other
programs want that core while it is measured.
"""

import multiprocessing
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, EvaluationResult, evaluate
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task


def timed(
    task: Task,
    architecture: Architecture,
    psi: NDArray[np.float32] | None,
    request: EvaluationRequest,
) -> EvaluationResult:
    """`evaluate`, its `seconds` being those of the processor."""
    started = time.thread_time()
    result = evaluate(task, architecture, psi, request)
    return replace(result, seconds=time.thread_time() - started)


@dataclass(frozen=True)
class Processes:
    """Evaluates on all cores, one evaluation a core at a time."""

    executor: ProcessPoolExecutor

    def run(
        self,
        task: Task,
        architecture: Architecture,
        psi: NDArray[np.float32] | None,
        requests: Sequence[EvaluationRequest],
    ) -> list[EvaluationResult]:
        """Answers in the order of the requests."""
        return list(self.executor.map(partial(timed, task, architecture, psi), requests))


@contextmanager
def processes() -> Iterator[Processes]:
    """One process a core."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(mp_context=context) as executor:
        yield Processes(executor)


def columns(task: Task, results: Sequence[EvaluationResult]) -> dict[str, list[float]]:
    """Train steps, test steps and seconds of each evaluation, in the order of requests."""
    ordered = sorted(results, key=lambda result: result.index)
    return {
        "train_steps": [int(result.train_steps) for result in ordered],
        "test_steps": [test_steps(task, result) for result in ordered],
        "seconds": [round(result.seconds, 4) for result in ordered],
    }


def test_steps(task: Task, result: EvaluationResult) -> int:
    """Environment steps of the test episodes. Both tasks pay one reward of size 1 a step
    (Acrobot none at the goal: the count is then short of one step an episode)."""
    assert task.compiled, "other tasks may pay other rewards"
    return round(sum(map(abs, result.test_returns)))
