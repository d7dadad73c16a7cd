"""What is asked of an evaluation, and what comes of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.synthetic_env import SE, SEDistribution, StoredSE


@dataclass(frozen=True)
class Centre:
    """Train on the centre of the search distribution, or on a single given SE."""


@dataclass(frozen=True)
class Perturbed:
    """Train on centre + sign * eps, with eps drawn by `seed`."""

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


#: What an agent trains on.
TrainedOn = Centre | Perturbed | Initialized | Given | RealTask

#: What requests get their SE from: one SE, several, or a distribution; None for the real task.
SESource = SE | StoredSE | SEDistribution | tuple[SE | StoredSE, ...] | None


@dataclass(frozen=True)
class EvaluationRequest:
    """Input of one evaluation, besides the task and the SE or the distribution of SEs."""

    index: int  #: position among the requests of one call
    seed: int  #: of initial parameters, exploration, minibatches and test episodes
    agent: AgentHyperparameters
    on: TrainedOn = Centre()


def requested_se(se: SESource, on: TrainedOn) -> SE | None:
    """The SE that a request asks for, None for the real task. Raises InvalidInput if `se` does not
    hold it."""
    if isinstance(on, RealTask):
        return None
    if isinstance(on, Given) and isinstance(se, tuple):
        if not 0 <= on.number < len(se):
            raise InvalidInput(f"training on {on}: allowed are the SEs 0 to {len(se) - 1}")
        se, on = se[on.number], Centre()
    if isinstance(se, StoredSE):
        se = se.se
    if isinstance(se, SE) and isinstance(on, Centre):
        return se
    if not isinstance(se, SEDistribution) or isinstance(on, Given):
        needed = {Centre: "an SE or a distribution of SEs", Given: "a tuple of SEs"}
        raise InvalidInput(
            f"training on {on} needs {needed.get(type(on), 'a distribution of SEs')} (on the real "
            f"task, on=RealTask() needs none); got {se!r:.40}"
        )
    if isinstance(on, Perturbed):
        return se.perturbed(on.seed, on.sign)
    if isinstance(on, Initialized):
        return se.random(on.seed)
    return se.centre


@dataclass(frozen=True)
class Outcome:
    """Result of training and testing one fresh agent."""

    test_returns: tuple[float, ...]  #: of the test episodes on the real task
    train_steps: int
    train_episodes: int
    real_env_steps: int  #: of tests, and of training on the real task
    finite: bool  #: False: training or test diverged; the returns are the task's worst
    cost: float  #: core seconds, estimated (`bilevel.cost`)

    @property
    def score(self) -> float:
        """Mean return of the test episodes on the real task."""
        return float(np.mean(self.test_returns))


@dataclass(frozen=True)
class EvaluationResult(Outcome):
    """The outcome of the request `index`; only the measured `seconds` are not determined by it."""

    index: int
    seconds: float


_Result = TypeVar("_Result", bound=Outcome)


def comparable(results: Sequence[_Result]) -> list[_Result]:
    """The results with test returns by which they can be compared. A diverged agent gets no more
    than the lowest score of the others, however the task's worst score compares with them."""
    lowest = min((result.score for result in results if result.finite), default=np.inf)
    return [
        result
        if result.finite
        else replace(result, test_returns=tuple(min(one, lowest) for one in result.test_returns))
        for result in results
    ]


def scores_of(results: Sequence[Outcome]) -> NDArray[np.float64]:
    """Scores (n,) of `comparable` results."""
    return np.array([result.score for result in comparable(results)])
