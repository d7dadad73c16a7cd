import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bilevel import InvalidInput
from cluster.bohb.study.brackets import (
    Schedule,
    budget_ladder,
    configurations_to_begin,
    core_seconds_to_run,
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
def test_ladder(smallest: int, largest: int, ladder: list[int]) -> None:
    assert budget_ladder(smallest, largest) == ladder


@pytest.mark.parametrize(("smallest", "largest"), [(0, 3), (4, 3), (-1, -1)])
def test_impossible_ladder(smallest: int, largest: int) -> None:
    with pytest.raises(InvalidInput, match="budgets must satisfy"):
        budget_ladder(smallest, largest)


@given(st.integers(1, 60), st.integers(0, 7))
def test_sizes_equal_hpbandsters(smallest: int, exponent: int) -> None:
    """hpbandster's own formula, for the ladders on which its logarithm is right."""
    ladder = budget_ladder(smallest, smallest * 3**exponent)
    assert len(ladder) == exponent + 1
    for bracket in range(exponent + 2):
        s = len(ladder) - 1 - bracket % len(ladder)
        first = int(np.floor(len(ladder) / (s + 1)) * 3**s)
        # It rounds down a power of 3, whose last bits are not to count.
        expected = [max(int(first * 3.0**-i + 1e-9), 1) for i in range(s + 1)]
        rungs = Schedule(tuple(ladder), len(ladder)).bracket(bracket)
        assert [rung.configurations for rung in rungs] == expected
        assert [rung.budget for rung in rungs] == ladder[-s - 1 :]


def test_random_search_has_the_largest_budget_alone() -> None:
    assert Schedule.of("random", 1, 9) == Schedule((9,), 1)
    assert Schedule.of("random", 1, 9, cycle=2) == Schedule((9,), 1)
    for method in ("hyperband", "bohb"):
        assert Schedule.of(method, 1, 9) == Schedule((1, 3, 9), 3)
        assert Schedule.of(method, 1, 9, cycle=2) == Schedule((1, 3, 9), 2)


def test_in_a_cycle_of_one_all_begin_at_the_smallest_budget() -> None:
    rungs = Schedule((3, 9), 1).brackets(3)
    assert [(r.bracket, r.configurations, r.budget) for r in rungs] == [
        *((0, 3, 3), (0, 1, 9)),
        *((1, 3, 3), (1, 1, 9)),
        *((2, 3, 3), (2, 1, 9)),
    ]
    assert core_seconds_to_run(rungs) == 3 * (3 * 3 + 6)


@pytest.mark.parametrize("cycle", [0, 3])
def test_impossible_cycle(cycle: int) -> None:
    with pytest.raises(InvalidInput, match=f"must be 1 to 2 .*; got {cycle}"):
        Schedule((3, 9), cycle)


@pytest.mark.parametrize(("brackets", "begun"), [(1, 9), (2, 12), (3, 15), (4, 24)])
def test_configurations_are_counted_once(brackets: int, begun: int) -> None:
    assert configurations_to_begin(LADDER.brackets(brackets)) == begun


def test_promoted_configurations_continue() -> None:
    table = Schedule((2, 6, 18), 3).brackets(3)
    assert core_seconds_to_run(table) == (9 * 2 + 3 * 4 + 12) + (3 * 6 + 12) + 3 * 18
