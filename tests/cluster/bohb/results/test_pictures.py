"""The picture of a study shows the differences between its good results."""

from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from matplotlib.figure import Figure

from bilevel.tasks import Task
from cluster.bohb.results.pictures import objective_against_cost
from cluster.bohb.results.summary import ResultPoint, ValidatedPoint
from cluster.bohb.study.journal import Origin
from cluster.pictures import png

ORIGINS = (Origin.RANDOM, Origin.AROUND_RECIPE, Origin.MODEL)


def points(*objectives: float) -> list[ResultPoint]:
    """Results of 5 core seconds each, one a minute; every third comes from the model."""
    return [
        ResultPoint(5 * (i + 1), 5, 60.0 * (i + 1), objective, origin, (0, 0, i))
        for i, (objective, origin) in enumerate(zip(objectives, cycle(ORIGINS), strict=False))
    ]


def labels(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_bad_draws_do_not_crush_the_best(cartpole: Task) -> None:
    """The differences between 40, 60 and 80 core seconds take a fifth of the height."""
    figure = objective_against_cost(
        points(6000.0, 900.0, 5000.0, 80.0, 60.0, 40.0), [], cartpole, "s"
    )
    (axes, *_) = figure.axes
    figure.canvas.draw()
    heights = axes.transAxes.inverted().transform(axes.transData.transform([(0, 40), (0, 80)]))
    assert heights[1, 1] - heights[0, 1] > 0.1
    assert "best so far after 5 core seconds: 40" in labels(figure)


def test_a_second_axis_tells_minutes(cartpole: Task) -> None:
    figure = objective_against_cost(points(10.0, 20.0, 30.0, 40.0, 50.0), [], cartpole, "study")
    figure.canvas.draw()
    (above,) = figure.axes[0].child_axes
    assert above.get_xlabel() == "minutes since the search began"
    assert [text.get_text() for text in above.get_xticklabels()] == ["0", "1", "2", "3", "4", "5"]


def test_a_short_search_is_told_in_seconds(cartpole: Task) -> None:
    figure = objective_against_cost(points(10.0, 20.0), [], cartpole, "study")
    figure.canvas.draw()
    (above,) = figure.axes[0].child_axes
    assert above.get_xlabel() == "seconds since the search began"
    ticks = [int(text.get_text()) for text in above.get_xticklabels()]
    assert ticks[0] == 0
    assert len(set(np.diff(ticks))) == 1


@pytest.mark.parametrize("objectives", [(), (9.0,), (9.0, 9.0), (9000.0, 9000.0, 80.0)])
def test_few_or_equal_results_are_drawn_too(objectives: tuple[float, ...], acrobot: Task) -> None:
    assert png(objective_against_cost(points(*objectives), [], acrobot, "study"))


def test_finalists_are_within_the_axes(cartpole: Task) -> None:
    """They come after the last result; the incumbent's objective over new seeds is told."""
    searched = points(50.0, 20.0, 30.0)
    validated = [
        ValidatedPoint(searched[2], 25, 70.0),
        ValidatedPoint(searched[1], 25, 90.0),
    ]
    figure = objective_against_cost(searched, validated, cartpole, "study")
    figure.canvas.draw()
    assert figure.axes[0].get_xlim()[1] > 25
    assert "incumbent, new seeds: 70" in labels(figure)
    assert "other finalists, new seeds: 90" in labels(figure)


def test_a_pause_does_not_print_times_over_each_other(cartpole: Task) -> None:
    """The second half of the results comes after an hour without any."""
    late = [
        replace(point, seconds=point.seconds + (3600 if number > 5 else 0))
        for number, point in enumerate(points(*np.arange(11.0, 21.0)), start=1)
    ]
    figure = objective_against_cost(late, [], cartpole, "study")
    figure.canvas.draw()
    (above,) = figure.axes[0].child_axes
    assert len(above.get_xticks()) > 1
    assert np.diff(above.get_xticks()).min() > 0.04 * 50
