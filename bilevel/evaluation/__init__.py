"""One evaluation: train a fresh agent on an SE, score it on the real task.

An evaluation is a pure function of its request, the task and the SEs. So a pool of actors may run
requests in any order, and repeat them.
"""

from bilevel.evaluation.recording import record
from bilevel.evaluation.requests import (
    Centre,
    EvaluationRequest,
    EvaluationResult,
    Given,
    Initialized,
    Outcome,
    Perturbed,
    RealTask,
    SESource,
    TrainedOn,
    comparable,
    scores_of,
)
from bilevel.evaluation.run import evaluate, train_and_test

__all__ = [
    "Centre",
    "EvaluationRequest",
    "EvaluationResult",
    "Given",
    "Initialized",
    "Outcome",
    "Perturbed",
    "RealTask",
    "SESource",
    "TrainedOn",
    "comparable",
    "evaluate",
    "record",
    "scores_of",
    "train_and_test",
]
