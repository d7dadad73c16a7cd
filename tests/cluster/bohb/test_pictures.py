"""The picture of a study shows the differences between its good results."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from bilevel.tasks import Task
from cluster.bohb.pictures import objective_against_cost
from cluster.bohb.summary import ResultPoint
from cluster.tracking.pictures import png


def points(*objectives: float) -> list[ResultPoint]:
    """Results of 5 generations each, one a minute; every third comes from the model."""
    return [
        ResultPoint(5 * (i + 1), 5, 60.0 * (i + 1), objective, i % 3 == 2)
        for i, objective in enumerate(objectives)
    ]


def labels(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_bad_draws_do_not_crush_the_best(cartpole: Task) -> None:
    figure = objective_against_cost(points(9.0, 9.5, 10.0, 190.0, 195.0, 199.0), cartpole, "study")
    bottom, top = figure.axes[0].get_ylim()
    assert 50 < bottom < 100
    assert 199 < top < 215
    assert "drawn at random, below the axis" in labels(figure)
    assert "incumbent after 5 generations: 199.0" in labels(figure)


def test_a_second_axis_tells_minutes(cartpole: Task) -> None:
    figure = objective_against_cost(points(10.0, 20.0, 30.0, 40.0, 50.0), cartpole, "study")
    figure.canvas.draw()
    (above,) = figure.axes[0].child_axes
    assert above.get_xlabel() == "minutes since the search began"
    assert [text.get_text() for text in above.get_xticklabels()] == ["0", "1", "2", "3", "4", "5"]


def test_a_short_search_is_told_in_seconds(cartpole: Task) -> None:
    figure = objective_against_cost(points(10.0, 20.0), cartpole, "study")
    figure.canvas.draw()
    (above,) = figure.axes[0].child_axes
    assert above.get_xlabel() == "seconds since the search began"
    ticks = [int(text.get_text()) for text in above.get_xticklabels()]
    assert ticks[0] == 0
    assert len(set(np.diff(ticks))) == 1


@pytest.mark.parametrize("objectives", [(), (9.0,), (9.0, 9.0), (-500.0, -500.0, -80.0)])
def test_few_or_equal_results_are_drawn_too(objectives: tuple[float, ...], acrobot: Task) -> None:
    assert png(objective_against_cost(points(*objectives), acrobot, "study"))
