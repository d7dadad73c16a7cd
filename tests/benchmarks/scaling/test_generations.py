"""The scenarios of one generation, on evaluations whose answers are known."""

import numpy as np
import pytest

from benchmarks.scaling.alternatives import asynchronous, larger_population
from benchmarks.scaling.generations import GENERATION, MEMBERS, spread, summary
from benchmarks.scaling.ordering import ordering, ordering_of_varied
from benchmarks.scaling.recorded import Evaluations, RecordedRun, VariedGeneration
from benchmarks.scaling.simulation import PoolOverhead, Timeline

NONE = PoolOverhead()


def evaluations(seconds: list[float]) -> Evaluations:
    """A step a millisecond."""
    values = np.array(seconds)
    return Evaluations((values * 1000).astype(int), values)


IDENTICAL = evaluations([1.0] * GENERATION)
#: psi's own agents take a quarter of what the others take.
SHORT_FIRST = evaluations([1.0] * MEMBERS + [4.0] * 2 * MEMBERS)


def run_of(*generations: Evaluations) -> RecordedRun:
    return RecordedRun("CartPole-v0", IDENTICAL, IDENTICAL, generations, 0.0)


def test_means_weigh_generations_by_their_time() -> None:
    row = summary([Timeline(4, 8, 2.0, 8.0), Timeline(4, 8, 6.0, 8.0)])
    assert (row["seconds"], row["efficiency"], row["straggler_share"]) == (4.0, 0.5, 0.5)


def test_spread_of_identical_evaluations() -> None:
    row = spread([IDENTICAL, IDENTICAL])
    assert (row["mean_seconds"], row["coefficient_of_variation"], row["longest_to_mean"]) == (
        1.0,
        0.0,
        1.0,
    )


def test_never_waiting_gains_nothing_where_nobody_waits() -> None:
    rows = asynchronous([IDENTICAL], 0.0, [16, 24, 48], NONE)
    assert [row["gain"] for row in rows] == [1.0, 1.0, 1.0]


def test_never_waiting_gains_the_longest_over_the_mean() -> None:
    (row,) = asynchronous([SHORT_FIRST], 0.5, [64], NONE)
    assert row["gain"] == pytest.approx((4.0 + 0.5) / SHORT_FIRST.seconds.mean(), rel=1e-3)


def test_populations_of_identical_evaluations_fill_the_cores() -> None:
    for row in larger_population([IDENTICAL], NONE):
        assert row["filling"] == row["at_equal_time"] == max(row["cores"] // 3, MEMBERS)
        assert row["filling_seconds"] == 1.0


def test_longest_first_gains_what_the_forecast_is_worth() -> None:
    """On 16 cores, 47 evaluations of a second and one of four: 6 seconds if it comes last,
    4 if it comes first."""
    last = evaluations([1.0] * (GENERATION - 1) + [4.0])
    first = evaluations([4.0] + [1.0] * (GENERATION - 1))
    foreseen = ordering(run_of(last, last), [16], NONE)
    assert [row["saved"]["16"] for row in foreseen] == pytest.approx([1 / 3] * 3, rel=1e-3)
    by_request, _, known = ordering(run_of(first, last), [16], NONE)
    assert by_request["saved"]["16"] == 0.0
    assert known["saved"]["16"] == pytest.approx(1 / 3, rel=1e-3)


def test_sizes_of_varied_agents_tell_the_longest() -> None:
    sizes = np.array([[1, 42, 42]] * (MEMBERS - 1) + [[3, 384, 384]])
    seconds = np.tile([1.0] * (MEMBERS - 1) + [9.0], 3)
    one = VariedGeneration(0, evaluations(seconds.tolist()), sizes)
    for row in ordering_of_varied([one], [8, 16], NONE):
        assert all(share > 0.2 for share in row["saved"].values())
