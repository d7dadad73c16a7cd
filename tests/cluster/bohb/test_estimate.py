from dataclasses import replace
from pathlib import Path

import pytest

from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource
from bilevel.tasks import Task
from cluster.bohb.estimate import Estimate, measured_speed
from cluster.bohb.study.brackets import Schedule
from cluster.session.terminal import Terminal
from tests.results import made_up_result
from tests.studies import new_study


def test_the_speed_is_measured_on_random_configurations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests: list[EvaluationRequest] = []

    def evaluate(task: Task, se: SESource, request: EvaluationRequest) -> EvaluationResult:
        requests.append(request)
        return replace(made_up_result(request.index, 1.0, cost=0.5), seconds=3.5)

    monkeypatch.setattr("cluster.bohb.estimate.evaluate", evaluate)
    with Terminal() as terminal:
        assert measured_speed(new_study(tmp_path), 2, terminal) == 7.0
    assert len({request.seed for request in requests}) == 6  # one per configuration


@pytest.mark.parametrize(("seconds", "brackets"), [(120.0, 3), (119.0, 2), (1.0, 1), (1e9, 1000)])
def test_brackets_within_a_time_budget(seconds: float, brackets: int) -> None:
    """A bracket takes 15 core seconds, and a third of that for validation."""
    estimate = Estimate(Schedule((3, 9), 1), brackets=1000, speed=2.0, cores=1)
    assert estimate.within(seconds) == replace(estimate, brackets=brackets)
    assert replace(estimate, cores=4).seconds == pytest.approx(estimate.seconds / 4)


def test_a_short_search_has_no_validation() -> None:
    estimate = Estimate(Schedule((3, 9), 1), brackets=1, speed=2.0, cores=1)
    assert estimate.core_seconds == (15, 0)
    assert estimate.seconds == 30.0
