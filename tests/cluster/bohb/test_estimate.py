"""The estimated time of a study."""

from dataclasses import replace
from pathlib import Path

import pytest

from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource
from bilevel.tasks import Task
from cluster.bohb import estimate as estimating
from cluster.bohb.command import StudyCommand
from cluster.bohb.estimate import Estimate
from cluster.bohb.study.brackets import Schedule
from cluster.session.context import RunContext
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from tests.results import made_up_result
from tests.studies import new_study


def test_the_speed_is_what_evaluations_of_random_configurations_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[EvaluationRequest] = []

    def evaluate(task: Task, se: SESource, request: EvaluationRequest) -> EvaluationResult:
        asked.append(request)
        return replace(made_up_result(request.index, 1.0, cost=0.5), seconds=3.5)

    monkeypatch.setattr(estimating, "evaluate", evaluate)
    study = new_study(tmp_path)
    context = RunContext(Home(tmp_path), "sqlite:///none.db")
    command = StudyCommand(study, context, 2, None, 4, workers_per_trial=1)
    with Terminal() as terminal:
        found = estimating._estimate(command, 2, terminal)
    assert found == Estimate(study.schedule, 2, speed=7.0, cores=2)
    assert len({request.seed for request in asked}) == 6  # one of each configuration


def test_what_a_time_budget_is_enough_for() -> None:
    """As many brackets as end in time, at least one."""
    estimate = Estimate(Schedule((3, 9), 1), brackets=1000, speed=2.0, cores=1)
    # Of 15 core seconds each, and a third as much for validation.
    assert estimate.within(120.0) == replace(estimate, brackets=3)
    assert estimate.within(119.0) == replace(estimate, brackets=2)
    assert estimate.within(1.0) == replace(estimate, brackets=1)
    assert estimate.within(1e9) == estimate
    assert str(estimate.within(0.0)).startswith(
        "1 bracket: 3 configurations, 15 core seconds (too few for a validation): 30s on 1 core,"
    )
    assert replace(estimate, cores=4).seconds == pytest.approx(estimate.seconds / 4)
