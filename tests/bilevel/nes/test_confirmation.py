"""When an SE is confirmed to solve the task."""

import pytest

from bilevel.nes.confirmation import Confirmation

SOLVED = 195.0


@pytest.mark.parametrize(
    ("rounds", "verdict"),
    [
        ([[194.9] * 4], False),
        ([[195.0] * 4], None),
        ([[195.0] * 4, [195.0] * 12], None),
        # 198.1 on average, whose standard error is 1.9
        ([[200.0] * 4, [200.0] * 11 + [170.0]], False),
        ([[200.0] * 4, [200.0] * 11 + [190.0]], None),
        ([[200.0] * 4, [200.0] * 12, [195.0] * 2], True),
        ([[200.0] * 4, [200.0] * 12, [194.0] * 2], False),
        # 199 and 197.5 on average, whose standard errors are 1 and 2.5
        ([[200.0] * 4, [200.0] * 12, [200.0, 198.0]], True),
        ([[200.0] * 4, [200.0] * 12, [200.0, 195.0]], False),
    ],
)
def test_every_round_must_solve_the_task(rounds: list[list[float]], verdict: bool | None) -> None:
    confirmation = Confirmation(2)
    for scores in rounds:
        assert confirmation.verdict(SOLVED) is None if confirmation.scores else True
        confirmation = confirmation.after(scores)
    assert confirmation.verdict(SOLVED) is verdict


def test_narrowed_agents_come_first_and_large_ones_last() -> None:
    confirmation, seen = Confirmation(2), list[int]()
    for narrowed, size in ((True, 4), (True, 12), (False, 2)):
        assert confirmation.narrowed is narrowed
        assert len(confirmation.coming) == size
        seen += confirmation.coming
        confirmation = confirmation.after([200.0] * size)
    assert seen == list(range(confirmation.total))
    assert (confirmation.of_narrowed.size, confirmation.of_all_sizes.size) == (16, 2)


def test_one_agent_has_no_spread() -> None:
    confirmation = Confirmation(1)
    for size in (2, 6, 1):
        confirmation = confirmation.after([SOLVED] * size)
    assert confirmation.verdict(SOLVED) is True
