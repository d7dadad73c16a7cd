"""Evaluation requests and results."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.synthetic_env import SE, SEDistribution, StoredSE


@dataclass(frozen=True)
class Centre:
    """Train on the unperturbed SE of the search distribution, or on a single given SE."""


@dataclass(frozen=True)
class Perturbed:
    """Train on mean + sign * eps: the mean of the search distribution and noise from `seed`."""

    seed: int
    sign: int  #: 1 or -1


@dataclass(frozen=True)
class Initialized:
    """Train on a random SE, drawn by `seed`."""

    seed: int


@dataclass(frozen=True)
class Given:
    """Train on one of several given SEs."""

    number: int  #: of the SE, from 0


@dataclass(frozen=True)
class RealTask:
    """Train on the real task, without an SE."""


#: The environment that an agent trains on.
TrainedOn = Centre | Perturbed | Initialized | Given | RealTask

#: The source of a request's SE: one SE, several, or a distribution; None for the real task.
SESource = SE | StoredSE | SEDistribution | tuple[SE | StoredSE, ...] | None


@dataclass(frozen=True)
class EvaluationRequest:
    """Input of one evaluation, in addition to the task and the source of SEs."""

    index: int  #: position among the requests of one call
    seed: int  #: of initial parameters, exploration, minibatches and test episodes
    agent: AgentHyperparameters
    on: TrainedOn = Centre()


def requested_se(source: SESource, on: TrainedOn) -> SE | None:
    """The SE of a request, None for the real task. Raises InvalidInput if `source` lacks it."""
    if isinstance(on, RealTask):
        return None
    if isinstance(on, Given) and isinstance(source, tuple) and 0 <= on.number < len(source):
        source, on = source[on.number], Centre()
    if isinstance(source, StoredSE):
        source = source.se
    match on, source:
        case Centre(), SE():
            return source
        case Centre(), SEDistribution():
            return source.centre
        case Perturbed(), SEDistribution():
            return source.perturbed(on.seed, on.sign)
        case Initialized(), SEDistribution():
            return source.random(on.seed)
    raise InvalidInput(
        f"training on {on} is not possible with {source!r:.40}: Centre needs an SE or a "
        "distribution of SEs, Perturbed and Initialized a distribution, and Given a tuple of SEs"
    )


@dataclass(frozen=True)
class EvaluationResult:
    """Result of one fresh agent; the request determines all fields except `seconds`."""

    test_returns: tuple[float, ...]  #: of the test episodes on the real task
    train_steps: int
    train_episodes: int
    real_env_steps: int  #: of tests, and of training on the real task
    finite: bool  #: False: training or test diverged; the returns are the task's worst
    cost: float  #: core seconds, estimated (`core_seconds`)
    index: int = 0  #: of the request
    seconds: float = 0.0  #: measured

    @property
    def score(self) -> float:
        """Mean return of the test episodes on the real task."""
        return float(np.mean(self.test_returns))


def comparable(results: Sequence[EvaluationResult]) -> list[EvaluationResult]:
    """The results with comparable test returns: the returns of a diverged agent are cut at the
    lowest score of all other agents, which may be below the task's worst score."""
    lowest = min((result.score for result in results if result.finite), default=np.inf)
    return [
        result
        if result.finite
        else replace(result, test_returns=tuple(min(r, lowest) for r in result.test_returns))
        for result in results
    ]


def scores_of(results: Sequence[EvaluationResult]) -> NDArray[np.float64]:
    """Scores (n,) of `comparable` results."""
    return np.array([result.score for result in comparable(results)])
