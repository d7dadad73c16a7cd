"""Verdicts of confirmations."""

import numpy as np
import pytest

from bilevel.nes.confirmation import (
    Confirming,
    solving_share,
)

SOLVED = 195.0

#: Rounds of 64 agents that pass.
FIRST, SECOND = [200.0] * 8, [200.0] * 24


@pytest.mark.parametrize(
    ("rounds", "verdict"),
    [
        ([[194.9] * 8], False),
        ([[195.0] * 8], None),
        ([[195.0] * 8, [195.0] * 24], None),
        ([[195.0] * 8, [194.0] * 24], False),
        ([[195.0] * 8, [195.0] * 24, [195.0] * 32], True),
        # a sample of ten contains the bad agent with a probability of 15 %
        ([FIRST, SECOND, [200.0] * 31 + [140.0]], False),
        ([FIRST, SECOND, [200.0] * 31 + [160.0]], True),
        # and two bad agents with a probability of 4 %
        ([FIRST, SECOND, [200.0] * 29 + [160.0] * 3], False),
        ([FIRST, SECOND, [200.0] * 30 + [160.0] * 2], True),
    ],
)
def test_every_round_must_solve_the_task(rounds: list[list[float]], verdict: bool | None) -> None:
    confirmation = Confirming(64)
    for scores in rounds:
        assert confirmation.verdict(SOLVED) is None if confirmation.scores else True
        assert len(confirmation.coming) == len(scores)
        confirmation = confirmation.after(scores)
    assert confirmation.verdict(SOLVED) is verdict


def test_each_failure_lowers_the_required_share() -> None:
    """If 3 of 64 agents score 160, 92 % of the means of ten solve the task."""
    verdicts = []
    for refuted in range(4):
        confirmation = Confirming(64, refuted)
        for scores in (FIRST, SECOND, [200.0] * 29 + [160.0] * 3):
            confirmation = confirmation.after(scores)
        verdicts.append(confirmation.verdict(SOLVED))
    assert verdicts == [False, False, False, True]
    confirmation = Confirming(64, 99)
    for scores in (FIRST, SECOND, [200.0] * 28 + [160.0] * 4):  # 87 %
        confirmation = confirmation.after(scores)
    assert confirmation.verdict(SOLVED) is False  # never below MIN_SHARE


def test_the_share_of_samples_is_binomial() -> None:
    """A fifth of the agents scores 0, the others 200; the mean of ten is 160 if two are bad."""
    scores = np.repeat([0.0, 200.0], [20, 80])
    assert solving_share(scores, 160.0) == pytest.approx(0.678, abs=0.02)
