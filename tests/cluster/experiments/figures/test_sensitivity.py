"""Groups of agents by a hyperparameter."""

import itertools
import math
from typing import Any

import numpy as np
import pandas as pd
import pytest

from bilevel.tasks import Task
from cluster.experiments.figures.sensitivity import grouped, scatter_plots


def test_groups_are_values_or_fifths() -> None:
    few = grouped(np.array([3.0, 1.0, 3.0, 2.0]))
    assert [group.tolist() for group in few] == [[1], [3], [0, 2]]
    values = np.random.default_rng(0).uniform(size=50)
    fifths = grouped(values)
    assert [len(group) for group in fifths] == [10] * 5
    assert all(values[low].max() < values[high].min() for low, high in itertools.pairwise(fifths))


def test_bars_are_standard_errors(cartpole: Task) -> None:
    """A group of one agent has none."""
    varied = pd.DataFrame({"hidden_layers": [1.0, 1.0, 1.0, 2.0]})
    figure = scatter_plots(varied, np.array([100.0, 130.0, 190.0, 200.0]), cartpole, "ddqn")
    bars: Any = figure.axes[0].containers[0]
    (bar,) = (one for one in bars.lines[2][0].get_segments() if len(one) and np.isfinite(one).all())
    low, high = bar[:, 1]
    assert (high - low) / 2 == pytest.approx(np.std([100, 130, 190], ddof=1) / math.sqrt(3))
