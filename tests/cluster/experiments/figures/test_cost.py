"""The number of agents after which an SE pays off."""

import pytest

from cluster.experiments.figures.cost import break_even


@pytest.mark.parametrize(
    ("cost", "saved", "agents"), [(50_000, 1000, 50), (0, 999, 0), (1, 0, None), (1, -5, None)]
)
def test_break_even(cost: float, saved: float, agents: float | None) -> None:
    assert break_even(cost, saved) == agents
