"""The estimated time of a study."""

from dataclasses import replace

import pytest

from cluster.bohb.brackets import Schedule
from cluster.bohb.estimate import Estimate


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
