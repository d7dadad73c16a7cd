import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bilevel import InvalidInput
from cluster.bohb.study.brackets import (
    Schedule,
    budget_ladder,
    core_seconds_to_run,
    initial_configurations,
)
from tests.searches import LADDER


@pytest.mark.parametrize(
    ("smallest", "largest", "ladder"),
    [
        (1, 243, [1, 3, 9, 27, 81, 243]),
        (2, 18, [2, 6, 18]),
        (7, 200, [7, 22, 67, 200]),
        (5, 5, [5]),
    ],
)
def test_budget_ladder(smallest: int, largest: int, ladder: list[int]) -> None:
    assert budget_ladder(smallest, largest) == ladder


@pytest.mark.parametrize(("smallest", "largest"), [(0, 3), (4, 3), (-1, -1)])
def test_invalid_budgets(smallest: int, largest: int) -> None:
    with pytest.raises(InvalidInput, match="budgets must satisfy"):
        budget_ladder(smallest, largest)


@pytest.mark.parametrize("cycle", [0, 3])
def test_invalid_cycle(cycle: int) -> None:
    with pytest.raises(InvalidInput, match=f"must be 1 to 2 .*; got {cycle}"):
        Schedule((3, 9), cycle)


@given(st.integers(1, 60), st.integers(0, 7))
def test_bracket_sizes_equal_hpbandsters_formula(smallest: int, exponent: int) -> None:
    """For ladders on which the formula's logarithm is exact."""
    ladder = budget_ladder(smallest, smallest * 3**exponent)
    assert len(ladder) == exponent + 1
    for bracket in range(exponent + 2):
        s = len(ladder) - 1 - bracket % len(ladder)
        first = int(np.floor(len(ladder) / (s + 1)) * 3**s)
        expected = [max(int(first * 3.0**-i + 1e-9), 1) for i in range(s + 1)]
        rungs = Schedule(tuple(ladder), len(ladder)).bracket(bracket)
        assert [rung.configurations for rung in rungs] == expected
        assert [rung.budget for rung in rungs] == ladder[-s - 1 :]


@pytest.mark.parametrize(
    ("method", "cycle", "schedule"),
    [
        ("random", None, Schedule((9,), 1)),
        ("random", 2, Schedule((9,), 1)),
        ("hyperband", None, Schedule((1, 3, 9), 3)),
        ("bohb", 2, Schedule((1, 3, 9), 2)),
    ],
)
def test_schedule_of_a_method(method: str, cycle: int | None, schedule: Schedule) -> None:
    assert Schedule.of(method, 1, 9, cycle) == schedule


def test_with_a_cycle_of_one_all_brackets_start_at_the_smallest_budget() -> None:
    rungs = Schedule((3, 9), 1).brackets(2)
    found = [(r.bracket, r.configurations, r.budget) for r in rungs]
    assert found == [(0, 3, 3), (0, 1, 9), (1, 3, 3), (1, 1, 9)]


def test_promoted_configurations_count_once() -> None:
    begun = [initial_configurations(LADDER.brackets(count)) for count in range(1, 5)]
    assert begun == [9, 12, 15, 24]
    rungs = Schedule((2, 6, 18), 3).brackets(3)
    assert core_seconds_to_run(rungs) == (9 * 2 + 3 * 4 + 12) + (3 * 6 + 12) + 3 * 18
