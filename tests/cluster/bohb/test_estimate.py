"""The estimated cost of a study."""

from dataclasses import replace

import pytest

from cluster.bohb.brackets import Schedule
from cluster.bohb.estimate import Estimate


def test_what_a_time_budget_is_enough_for() -> None:
    """As many brackets as end in time, at least one."""
    estimate = Estimate(
        Schedule((3, 9), 1),
        brackets=1000,
        evaluations_per_generation=10.0,
        seconds_per_evaluation=0.5,
        start_evaluations=0,
        cores=1,
    )
    assert estimate.within(225.0) == replace(estimate, brackets=3)  # of 15 generations each
    assert estimate.within(224.0) == replace(estimate, brackets=2)
    assert estimate.within(1.0) == replace(estimate, brackets=1)
    assert estimate.within(1e9) == estimate
    choosing = replace(estimate, start_evaluations=8)
    # every configuration that a bracket begins chooses its start once
    assert choosing.evaluations - estimate.evaluations == 1000 * 3 * 8
    assert choosing.seconds - estimate.seconds == pytest.approx(1000 * 3 * 8 * 0.5)
    assert str(choosing.within(0.0)).startswith("1 bracket: 15 generations, 174 evaluations")
    assert replace(estimate, cores=4).seconds == pytest.approx(estimate.seconds / 4)
