"""One evaluation: train a fresh agent on an SE, score it on the real task.

It is a pure function of its request, the task and the SEs: actors may repeat it in any order.
"""

from bilevel.evaluation.requests import (
    Centre,
    EvaluationRequest,
    EvaluationResult,
    Given,
    Initialized,
    Perturbed,
    RealTask,
    SESource,
    TrainedOn,
    comparable,
    scores_of,
)
from bilevel.evaluation.run import evaluate, record, train_and_test

__all__ = [
    "Centre",
    "EvaluationRequest",
    "EvaluationResult",
    "Given",
    "Initialized",
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
