"""Verdicts of confirmations."""

import numpy as np
import pytest

from bilevel.nes.confirmation import FINAL_AGENTS, FINAL_EPISODES, Confirming, solving_probability

SOLVED = 195.0

#: Rounds of 64 agents that pass.
FIRST, SECOND = [200.0] * 8, [200.0] * 24


def confirmed(rounds: list[list[float]], refuted: int = 0) -> Confirming:
    """Return a confirmation with 64 agents after rounds, in which an agent's returns are equal."""
    confirmation = Confirming(64, refuted)
    for scores in rounds:
        assert confirmation.verdict(SOLVED) is None if confirmation.rounds else True
        assert len(confirmation.coming) == len(scores)
        confirmation = confirmation.after([(score, score) for score in scores])
    return confirmation


@pytest.mark.parametrize(
    ("rounds", "verdict"),
    [
        ([[194.9] * 8], False),
        ([[195.0] * 8], None),
        ([[195.0] * 8, [195.0] * 24], None),
        ([[195.0] * 8, [194.0] * 24], False),
        ([[195.0] * 8, [195.0] * 24, [195.0] * 32], True),
        ([FIRST, SECOND, [200.0] * 31 + [150.0]], True),
        ([FIRST, SECOND, [200.0] * 31 + [100.0]], False),
    ],
)
def test_every_round_must_solve_the_task(rounds: list[list[float]], verdict: bool | None) -> None:
    assert confirmed(rounds).verdict(SOLVED) is verdict


def test_each_failure_lowers_the_required_probability() -> None:
    rounds = [FIRST, SECOND, [200.0] * 30 + [157.0] * 2]
    probability = solving_probability(np.array(confirmed(rounds).returns), SOLVED)
    assert 0.90 < probability < 0.94
    verdicts = [confirmed(rounds, refuted).verdict(SOLVED) for refuted in range(6)]
    assert verdicts[0] is False
    assert verdicts[-1] is True
    assert verdicts == sorted(verdicts, key=bool)
    never = [FIRST, SECOND, [200.0] * 30 + [120.0] * 2]
    assert confirmed(never, refuted=99).verdict(SOLVED) is False


def test_the_probability_separates_agents_and_episodes() -> None:
    """Against a simulation: two test episodes of 64 agents predict the mean of the final agents."""
    rng = np.random.default_rng(0)

    def returns(agents: int, episodes: int) -> np.ndarray:
        return rng.normal(0, 10, (agents, 1)) + rng.normal(0, 30, (agents, episodes))

    predicted = [solving_probability(returns(64, 2), -10.0) for _ in range(200)]
    means = [returns(FINAL_AGENTS, FINAL_EPISODES).mean() for _ in range(4000)]
    assert np.mean(predicted) == pytest.approx(np.mean(np.array(means) >= -10.0), abs=0.04)
    # If agents were all that differs, the same scores would predict a worse mean.
    scores = returns(64, 2).mean(axis=1)
    assert solving_probability(scores[:, None], -10.0) < np.mean(predicted)


def test_few_agents_are_less_certain() -> None:
    returns = np.random.default_rng(0).normal(0, 10, (8, 2))
    few, many = (solving_probability(np.tile(returns, (k, 1)), -5.0) for k in (1, 8))
    assert 0.5 < few < many - 0.01


def test_equal_returns_are_certain() -> None:
    returns = np.full((8, 2), 200.0)
    assert solving_probability(returns, 200.0) == 1.0
    assert solving_probability(returns, 201.0) == 0.0
