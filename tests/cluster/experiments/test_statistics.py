"""The numbers of success, cost and sensitivity."""

import itertools

import numpy as np
import pytest

from bilevel.tasks import Task, get_task
from cluster.experiments.cost import Cost
from cluster.experiments.sensitivity import grouped
from cluster.experiments.style import styled
from cluster.experiments.success import LearningCurve, carried_forward, findings_of


def course(*scores: float, condition: str = "default", final: float = 200.0) -> LearningCurve:
    return LearningCurve(
        condition, 0, np.array(scores), np.arange(1.0, len(scores) + 1), final_score=final
    )


def test_runs_that_ended_early_keep_their_last_score() -> None:
    np.testing.assert_array_equal(
        carried_forward([course(1, 2), course(3, 4, 5)]), [[1, 2, 2], [3, 4, 5]]
    )


def test_shares_of_runs(cartpole: Task) -> None:
    runs = [
        course(10, 196),  # solved, and ended
        course(10, 20, 199, 50, final=150.0),  # solved on the way
        course(10, 20, 30, 40, final=200.0),  # solves only what it hands over
        course(195, 0, 0, 0, final=0.0),
    ]
    with styled():
        (row,) = findings_of(runs, cartpole).summary
    assert row["runs"] == 4
    assert row["ever_solved"] == 0.75
    assert row["solved_at_end"] == 0.25
    assert row["handed_over_solved"] == 0.5
    assert row["median_first_solved"] == 1.0
    assert row["core_seconds_first_solved"] == 2.0
    assert row["score_at_end"] == pytest.approx((196 + 50 + 40 + 0) / 4)


def test_no_run_that_solves(cartpole: Task) -> None:
    with styled():
        (row,) = findings_of([course(10, 20)], cartpole).summary
    assert row["ever_solved"] == 0.0
    assert row["median_first_solved"] is row["core_seconds_first_solved"] is None


def test_when_an_se_is_paid_back() -> None:
    real = Cost(fixed=0.0, marginal=1000.0)
    assert Cost(50_000.0, 0.0).break_even(real) == 50.0
    assert Cost(50_000.0, 500.0).break_even(real) == 100.0
    assert Cost(1.0, 1000.0).break_even(real) is None
    assert Cost(0.0, 1.0).break_even(real) == 0.0


def test_groups_of_agents() -> None:
    few = grouped(np.array([3.0, 1.0, 3.0, 2.0]))
    assert [group.tolist() for group in few] == [[1], [3], [0, 2]]
    values = np.random.default_rng(0).uniform(size=50)
    fifths = grouped(values)
    assert [len(group) for group in fifths] == [10] * 5
    assert all(values[low].max() < values[high].min() for low, high in itertools.pairwise(fifths))


def test_the_picture_shows_scores_above_the_solved_reward() -> None:
    """As on tasks that count as solved below their highest return."""
    task = get_task("CartPole-v1", solved_reward=450.0, step_limit=500)
    with styled():
        figure = findings_of([course(10, 500)], task).figures["curves"]
    assert max(axes.get_ylim()[1] for axes in figure.axes) > 500
