"""The numbers of cost."""

from cluster.experiments.figures.cost import Cost


def test_when_an_se_is_paid_back() -> None:
    real = Cost(fixed=0.0, marginal=1000.0)
    assert Cost(50_000.0, 0.0).break_even(real) == 50.0
    assert Cost(50_000.0, 500.0).break_even(real) == 100.0
    assert Cost(1.0, 1000.0).break_even(real) is None
    assert Cost(0.0, 1.0).break_even(real) == 0.0
