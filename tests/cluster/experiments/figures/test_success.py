"""The numbers of success."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bilevel.nes.checkpoint import save_state
from bilevel.tasks import Task, get_task
from cluster.experiments.experiment import SERun, se_runs
from cluster.experiments.figures.success import LearningCurve, carried_forward, findings_of
from cluster.experiments.sizes import get_size
from cluster.experiments.style import styled
from cluster.nes.run import STATE_FILE
from cluster.storage.home import Home
from tests.cluster.experiments.made_up import end_run


@pytest.fixture
def nes_run(tmp_path: Path, cartpole: Task) -> SERun:
    """A run that has ended, whose scores are made up, and whose last confirmation has cost."""
    (made,) = se_runs({"default": 1}, cartpole, get_size("smoke"), 0, Home(tmp_path))
    end_run(made.run)
    state = made.state
    save_state(replace(state, cost=state.cost + 5), made.run.folder / STATE_FILE)
    return made


def course(*scores: float, condition: str = "default", final: float = 200.0) -> LearningCurve:
    seconds = np.arange(1.0, len(scores) + 1)
    return LearningCurve(
        condition, 0, np.array(scores), seconds, seconds / 10, seconds[-1] + 7, final_score=final
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
    assert row["core_seconds"] == 4 + 7  # with what is spent after the last generation
    assert row["update_norm"] == pytest.approx(0.2)
    assert row["score_at_end"] == pytest.approx((196 + 50 + 40 + 0) / 4)


def test_no_run_that_solves(cartpole: Task) -> None:
    with styled():
        (row,) = findings_of([course(10, 20)], cartpole).summary
    assert row["ever_solved"] == 0.0
    assert row["median_first_solved"] is row["core_seconds_first_solved"] is None


def test_the_picture_shows_scores_above_the_solved_reward() -> None:
    """As on tasks that count as solved below their highest return."""
    task = get_task("CartPole-v1", solved_reward=450.0, step_limit=500)
    with styled():
        figure = findings_of([course(10, 500)], task).figures["curves"]
    assert max(axes.get_ylim()[1] for axes in figure.axes) > 500


def test_the_last_confirmation_is_paid_for(nes_run: SERun) -> None:
    """It comes after the last generation's record."""
    curve, state = LearningCurve.of(nes_run), nes_run.state
    assert curve.total_core_seconds == state.cost
    np.testing.assert_array_equal(curve.core_seconds, [one.cost for one in state.records])
    np.testing.assert_array_equal(curve.update_norm, [one.update_norm for one in state.records])


@pytest.mark.parametrize(("generations", "stars"), [(200, 1), (50, 0)])
def test_where_the_authors_curve_ends(generations: int, stars: int, cartpole: Task) -> None:
    """A star at their 164, if ours goes on as long."""
    ours = [course(*[9.0] * generations, condition=name) for name in ("default", "authors")]
    with styled():
        figure = findings_of(ours, cartpole).figures["curves"]
    drawn = [line for axes in figure.axes for line in axes.lines if line.get_marker() == "*"]
    assert [np.asarray(line.get_xydata()).tolist() for line in drawn] == [[[199, 164]]] * stars
