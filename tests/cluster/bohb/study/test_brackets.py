import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cluster.bohb.study.brackets import Schedule, core_seconds_to_run, initial_configurations
from tests.searches import LADDER


@pytest.mark.parametrize(
    ("method", "smallest", "largest", "cycle", "schedule"),
    [
        ("bohb", 1, 243, None, Schedule((1, 3, 9, 27, 81, 243), 6)),
        ("hyperband", 7, 200, None, Schedule((7, 22, 67, 200), 4)),
        ("bohb", 5, 5, None, Schedule((5,), 1)),
        ("bohb", 1, 9, 2, Schedule((1, 3, 9), 2)),
        ("random", 1, 9, 2, Schedule((9,), 1)),
    ],
)
def test_schedule_of_a_method(
    method: str, smallest: int, largest: int, cycle: int | None, schedule: Schedule
) -> None:
    assert Schedule.of(method, smallest, largest, cycle) == schedule


@given(st.integers(1, 60), st.integers(0, 7))
def test_bracket_sizes_equal_hpbandsters_formula(smallest: int, exponent: int) -> None:
    """For ladders on which the formula's logarithm is exact."""
    schedule = Schedule.of("hyperband", smallest, smallest * 3**exponent)
    budgets = schedule.budgets
    assert len(budgets) == exponent + 1
    for bracket in range(exponent + 2):
        s = exponent - bracket % len(budgets)
        first = int(np.floor(len(budgets) / (s + 1)) * 3**s)
        expected = [max(int(first * 3.0**-i + 1e-9), 1) for i in range(s + 1)]
        rungs = schedule.bracket(bracket)
        assert [rung.configurations for rung in rungs] == expected
        assert tuple(rung.budget for rung in rungs) == budgets[-s - 1 :]


def test_promoted_configurations_count_once() -> None:
    begun = [initial_configurations(LADDER.brackets(count)) for count in range(1, 5)]
    assert begun == [9, 12, 15, 24]
    rungs = Schedule((2, 6, 18), 3).brackets(3)
    assert core_seconds_to_run(rungs) == (9 * 2 + 3 * 4 + 12) + (3 * 6 + 12) + 3 * 18
