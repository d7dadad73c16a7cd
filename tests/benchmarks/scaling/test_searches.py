"""How long the jobs of a simulated search take."""

import numpy as np
import pytest

from benchmarks.scaling.recorded import Evaluations, RecordedRun
from benchmarks.scaling.searches import Courses
from benchmarks.scaling.simulation import PoolOverhead
from bilevel.tasks import get_task
from cluster.bohb.search import Job
from cluster.profiles import base_hyperparameters, get_profile

BETWEEN = 0.5


def generation(seconds: float) -> Evaluations:
    return Evaluations(np.full(48, 100), np.linspace(0.5, 1.5, 48) * seconds)


#: Evaluations take two seconds at first, one second from then on.
RUN = RecordedRun(
    "CartPole-v0",
    generation(2.0),
    generation(2.0),
    (generation(2.0), generation(1.0)),
    BETWEEN,
)


def courses(workers: int) -> Courses:
    base = base_hyperparameters(get_profile("paper"), get_task("CartPole-v0"))
    return Courses(RUN, [10.0], base, workers, PoolOverhead())


def job(budget: int, mirrored: bool = True, number: int = 0) -> Job:
    return Job((0, 0, number), {"nes.mirrored_sampling": mirrored}, budget, False, 0.0)


def test_a_promoted_configuration_goes_on() -> None:
    course = courses(1)
    assert [len(course(job(budget)).seconds) for budget in (2, 6, 18)] == [2, 4, 12]


def test_one_worker_takes_what_is_busy() -> None:
    one = courses(1)(job(3))
    assert np.subtract(one.seconds, one.busy) == pytest.approx([BETWEEN] * 3)
    # The configuration's level is ten seconds; its evaluations get shorter by half.
    assert one.busy == pytest.approx([480.0, 240.0, 240.0], rel=0.1)


def test_workers_share_the_same_work() -> None:
    one, many = courses(1)(job(9)), courses(8)(job(9))
    assert one.busy == many.busy
    assert sum(many.seconds) > sum(one.seconds) / 8
    assert sum(many.seconds) < sum(one.seconds) / 5


def test_mirrored_sampling_takes_half_as_many_evaluations_more() -> None:
    mirrored, plain = courses(1)(job(50)), courses(1)(job(50, mirrored=False))
    assert sum(mirrored.busy) / sum(plain.busy) == pytest.approx(1.5, rel=0.05)
