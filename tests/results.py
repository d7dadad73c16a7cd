"""Artificial results of evaluations."""

from typing import Any

from bilevel.evaluation import EvaluationResult


def made_up_result(index: int, *scores: float, **changes: Any) -> EvaluationResult:
    """Return a result of the request `index` with these test returns; `changes` are other
    fields."""
    values: dict[str, Any] = {
        "test_returns": scores,
        "train_steps": 100,
        "train_episodes": 10,
        "real_env_steps": 7,
        "finite": True,
        "cost": 0.5,
        "index": index,
        "seconds": 0.01,
    }
    return EvaluationResult(**(values | changes))
