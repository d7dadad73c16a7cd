"""The parts into which a generation's time is taken apart."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.speed.generation import Parts

seconds = st.floats(1e-3, 1e3)
parts = st.builds(Parts, seconds, seconds, seconds, seconds, seconds)


@given(st.lists(parts, min_size=1, max_size=9))
def test_shares_of_all_parts_make_up_the_total(measured: list[Parts]) -> None:
    together = Parts.sum(measured)
    assert together.total == pytest.approx(sum(part.total for part in measured))
    assert sum(together.shares().values()) == pytest.approx(1, abs=3e-4)
    assert together.shares()["kernels"] == pytest.approx(
        sum(part.kernels for part in measured) / together.total, abs=1e-4
    )
