"""Verdicts of confirmations."""

import numpy as np
import pytest

from bilevel.nes.confirmation import (
    FINAL_AGENTS,
    REQUIRED_SHARE,
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


@pytest.mark.parametrize("bad", [0.0, 0.002, 0.01, 0.05])
def test_confirmation_predicts_the_next_agents(bad: float) -> None:
    """A share of the agents scores 100, the others 200; SEs with many bad agents are rejected."""
    rng = np.random.default_rng(0)
    confirmed = 0
    for _ in range(200):
        confirmation = Confirming(128)
        while not confirmation.scores or confirmation.verdict(SOLVED) is None:
            scores = np.where(rng.random(len(confirmation.coming)) < bad, 100.0, 200.0)
            confirmation = confirmation.after(scores.tolist())
        confirmed += bool(confirmation.verdict(SOLVED))
    solves = (1 - bad) ** FINAL_AGENTS
    if solves == 1:
        assert confirmed == 200
    else:
        assert (confirmed > 100) is (solves > REQUIRED_SHARE)


@pytest.mark.parametrize("agents", [1, 2, 3])
def test_few_agents_make_fewer_rounds(agents: int) -> None:
    confirmation = Confirming(agents)
    while not confirmation.scores or confirmation.verdict(SOLVED) is None:
        assert len(confirmation.coming) > 0
        confirmation = confirmation.after([SOLVED] * len(confirmation.coming))
    assert confirmation.verdict(SOLVED) is True
    assert confirmation.all_scores.size == agents


def test_the_share_of_samples_is_binomial() -> None:
    """A fifth of the agents scores 0, the others 200; the mean of ten is 160 if two are bad."""
    scores = np.repeat([0.0, 200.0], [20, 80])
    assert solving_share(scores, 160.0) == pytest.approx(0.678, abs=0.02)
