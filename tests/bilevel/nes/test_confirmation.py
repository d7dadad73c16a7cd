"""When an SE is confirmed to solve the task."""

import pytest

from bilevel.nes.confirmation import Confirmation


@pytest.mark.parametrize(
    ("scores", "verdict"),
    [
        ([195.0] * 9, True),
        ([194.9] * 9, False),
        ([200.0] * 8 + [170.0], False),  # 196.7 on average, twice whose standard error is 6.7
        ([200.0] * 8 + [190.0], True),
        ([200.0] * 2, None),
        ([100.0, 200.0], False),
    ],
)
def test_most_agents_are_trained_only_if_the_first_solve_the_task(
    scores: list[float], verdict: bool | None
) -> None:
    assert Confirmation(9).after(scores).verdict(195.0) is verdict


def test_a_quarter_comes_first() -> None:
    begun = Confirmation(9)
    assert list(begun.coming) == [0, 1]
    assert list(begun.after([200.0, 200.0]).coming) == [2, 3, 4, 5, 6, 7, 8]
    assert list(Confirmation(1).coming) == [0]
    assert Confirmation(1).after([195.0]).verdict(195.0) is True
