"""What a study would cost."""

from dataclasses import replace

from cluster.bohb.brackets import Schedule
from cluster.bohb.estimate import Estimate


def test_what_a_time_budget_is_enough_for() -> None:
    """The most brackets that end in time; the first one is always begun."""
    schedule = Schedule((3, 9), 1)
    estimate = Estimate(schedule, 1000, 10.0, 0.5, 0, 0.0, 0.0, trials=1, cores=1)
    assert estimate.within(225.0) == replace(estimate, brackets=3)  # of 15 generations each
    assert estimate.within(224.0) == replace(estimate, brackets=2)
    assert estimate.within(1.0) == replace(estimate, brackets=1)
    assert estimate.within(1e9) == estimate
    starting = replace(estimate, starts=2, seconds_per_start=10.0, seconds_per_fit=1.0)
    # three starts in turn, the tests of two, and a fit for each of three configurations
    assert starting.seconds - estimate.seconds == 30.0 + 64 * 0.5 + 3000 * 1.0
    assert str(starting.within(0.0)).startswith("1 bracket: 15 generations, 2 fitted starts")
