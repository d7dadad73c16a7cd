"""Groups of agents by a hyperparameter."""

import itertools

import numpy as np

from cluster.experiments.figures.sensitivity import grouped


def test_groups_are_values_or_fifths() -> None:
    few = grouped(np.array([3.0, 1.0, 3.0, 2.0]))
    assert [group.tolist() for group in few] == [[1], [3], [0, 2]]
    values = np.random.default_rng(0).uniform(size=50)
    fifths = grouped(values)
    assert [len(group) for group in fifths] == [10] * 5
    assert all(values[low].max() < values[high].min() for low, high in itertools.pairwise(fifths))
