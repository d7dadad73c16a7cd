from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.scaling.study import driver_overhead


@given(
    st.lists(st.integers(1, 9), min_size=4, max_size=30).filter(lambda g: len(set(g[1:-1])) > 1),
    st.floats(0.01, 1.0),
    st.floats(0.001, 0.1),
)
def test_driver_overhead_is_found_again(
    generations: list[int], per_job: float, per_report: float
) -> None:
    """Jobs of so many generations of half a second each, one after the other; before the
    first one the pool takes three seconds to start."""
    jobs: list[dict[str, Any]] = []
    now = 0.0
    for number, count in enumerate(generations):
        jobs.append({"submitted": now, "generation_seconds": [0.5] * count})
        now += (3.0 if number == 0 else 0.0) + per_job + count * (0.5 + per_report)
    found = driver_overhead({"jobs": jobs})
    assert found["job_seconds"] == pytest.approx(per_job, abs=1e-3)
    assert found["report_seconds"] == pytest.approx(per_report, abs=1e-3)
    assert found["start_seconds"] == pytest.approx(3.0, abs=2e-3)
