from itertools import cycle

import numpy as np
import pytest
from matplotlib.figure import Figure

from bilevel.tasks import Task
from cluster.bohb.results.importance import Importance
from cluster.bohb.results.pictures import hyperparameters, objective_against_cost
from cluster.bohb.results.summary import ResultPoint, ValidatedPoint
from cluster.bohb.study.journal import Origin
from cluster.pictures import png

ORIGINS = (Origin.RANDOM, Origin.AROUND_RECIPE, Origin.MODEL)


def points(*objectives: float) -> list[ResultPoint]:
    """Results of 5 core seconds each."""
    return [
        ResultPoint(5 * (i + 1), 5, objective, origin, (0, 0, i))
        for i, (objective, origin) in enumerate(zip(objectives, cycle(ORIGINS), strict=False))
    ]


@pytest.mark.parametrize("objectives", [(), (9.0,), (9.0, 9.0), (9000.0, 9000.0, 80.0)])
def test_few_or_equal_results(objectives: tuple[float, ...], cartpole: Task) -> None:
    assert png(objective_against_cost(points(*objectives), [], cartpole, "study"))


def test_finalists_are_inside_the_axes(cartpole: Task) -> None:
    """They come after the last result."""
    searched = points(50.0, 20.0, 30.0)
    validated = [ValidatedPoint(searched[i], 25, 70.0 + i) for i in (2, 1)]
    figure = objective_against_cost(searched, validated, cartpole, "study")
    figure.canvas.draw()
    assert figure.axes[0].get_xlim()[1] > 25


def drawn(explained: float | None, configurations: int = 5) -> Figure:
    """A picture of two hyperparameters, whose importances come from a forest with that R^2."""
    rng, names = np.random.default_rng(0), ("a", "b")
    tried = rng.random((configurations, 2))
    found = None
    if explained is not None:
        found = Importance(names, np.array([0.4, 0.1]), np.array([0.1, 0.1]), 3, 40, explained)
    recipe = np.array([0.5, np.nan])
    return hyperparameters(tried, tried[:2], recipe, names, found, "study")


@pytest.mark.parametrize(("explained", "bars"), [(0.5, 2), (-0.1, 0), (None, 0)])
def test_importances_of_an_accurate_forest_only(explained: float | None, bars: int) -> None:
    figure = drawn(explained)
    assert len(figure.axes[1].patches) == bars
    assert len(png(figure)) > 1000


def test_hyperparameters_without_results() -> None:
    assert png(drawn(None, configurations=0))
