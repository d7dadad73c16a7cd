"""When an SE is confirmed to solve the task."""

import math

import numpy as np
import pytest

from bilevel.nes.confirmation import JUDGES, Confirmation

SOLVED = 195.0

#: Rounds of narrowed agents that pass.
FIRST, SECOND, THIRD = [200.0] * 4, [200.0] * 12, [200.0] * 16


@pytest.mark.parametrize(
    ("rounds", "verdict"),
    [
        ([[194.9] * 4], False),
        ([[195.0] * 4], None),
        ([[195.0] * 4, [195.0] * 12], None),
        # 198.8 on average, with a standard deviation of 5: ten more may have 194.8
        ([FIRST, [200.0] * 11 + [180.0]], False),
        ([FIRST, [200.0] * 11 + [190.0]], None),
        # 198.8 on average after twice as many agents, with a standard deviation of 7
        ([FIRST, SECOND, [200.0] * 15 + [160.0]], False),
        ([FIRST, SECOND, [200.0] * 15 + [190.0]], None),
        ([FIRST, SECOND, THIRD, [195.0] * 2], True),
        ([FIRST, SECOND, THIRD, [194.0] * 2], False),
        # 199 on average: ten more may have 196.8
        ([FIRST, SECOND, THIRD, [200.0, 198.0]], True),
        ([FIRST, SECOND, THIRD, [200.0, 195.0]], False),
    ],
)
def test_every_round_must_solve_the_task(rounds: list[list[float]], verdict: bool | None) -> None:
    confirmation = Confirmation(2)
    for scores in rounds:
        assert confirmation.verdict(SOLVED) is None if confirmation.scores else True
        assert len(confirmation.coming) == len(scores)
        confirmation = confirmation.after(scores)
    assert confirmation.verdict(SOLVED) is verdict


@pytest.mark.parametrize("deviation", [2.0, 8.0])
def test_what_is_confirmed_holds_for_the_next_agents(deviation: float) -> None:
    """SEs whose agents have a mean score around the bound: of those that are confirmed, ten more
    agents solve nearly all."""
    rng = np.random.default_rng(0)
    held = []
    for _ in range(4000):
        mean = SOLVED + rng.uniform(0, 3) * deviation / math.sqrt(JUDGES)
        confirmation = Confirmation(4)
        while confirmation.verdict(SOLVED) is None if confirmation.scores else True:
            scores = rng.normal(mean, deviation, len(confirmation.coming))
            confirmation = confirmation.after(scores.tolist())
        if confirmation.verdict(SOLVED):
            held.append(rng.normal(mean, deviation, JUDGES).mean() >= SOLVED)
    assert len(held) > 100
    assert np.mean(held) > 0.95


def test_narrowed_agents_come_first_and_large_ones_last() -> None:
    confirmation, seen = Confirmation(2), list[int]()
    for narrowed, size in ((True, 4), (True, 12), (True, 16), (False, 2)):
        assert confirmation.narrowed is narrowed
        assert len(confirmation.coming) == size
        seen += confirmation.coming
        confirmation = confirmation.after([200.0] * size)
    assert seen == list(range(confirmation.total))
    assert (confirmation.of_narrowed.size, confirmation.of_all_sizes.size) == (32, 2)


def test_one_agent_has_no_spread() -> None:
    confirmation = Confirmation(1)
    for size in (2, 6, 8, 1):
        confirmation = confirmation.after([SOLVED] * size)
    assert confirmation.verdict(SOLVED) is True
