import pytest

from bilevel.nes.halving import Halving, Round

ROUNDS = (Round(8, 1), Round(3, 2), Round(2, 4))


@pytest.mark.parametrize(
    ("candidates", "sizes"), [(20, [8, 3, 2]), (8, [8, 3, 2]), (2, [2, 2, 2]), (1, [])]
)
def test_the_best_candidate_wins(candidates: int, sizes: list[int]) -> None:
    """Candidates beyond the first round's number are dropped, and the best one comes last."""
    halving, seen, evaluations = Halving.between(range(candidates), ROUNDS), [], []
    while halving.winner is None:
        seen.append(len(halving.left))
        evaluations.append(halving.agents * len(halving.left))
        assert halving.evaluations >= evaluations[-1]
        halving = halving.after(range(len(halving.left))[::-1])
    assert seen == sizes
    assert Halving.between(range(candidates), ROUNDS).evaluations == sum(evaluations)
    assert halving.evaluations == 0


def test_the_order_decides_who_stays() -> None:
    halving = Halving.between([10, 11, 12, 13], ROUNDS)
    assert halving.after([2, 0, 3, 1]).left == (12, 10, 13)
