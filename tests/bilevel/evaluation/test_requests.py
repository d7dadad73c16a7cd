import numpy as np
import pytest

from bilevel.errors import InvalidInput
from bilevel.evaluation import (
    Centre,
    EvaluationResult,
    Given,
    Initialized,
    Perturbed,
    RealTask,
    scores_of,
)
from bilevel.evaluation.requests import requested_se
from bilevel.hyperparameters import Hyperparameters
from bilevel.synthetic_env import SE
from bilevel.tasks import Task
from tests.ses import around, make_se


def test_requests_select_ses(cartpole: Task, small_hp: Hyperparameters) -> None:
    ses = around(cartpole, small_hp)

    def requested(source: object, on: object) -> SE:
        se = requested_se(source, on)  # type: ignore[arg-type]
        assert se is not None
        return se

    centre = requested(ses, Centre())
    plus, minus = (requested(ses, Perturbed(7, sign)) for sign in (1, -1))
    np.testing.assert_allclose(plus.psi + minus.psi, 2 * centre.psi, atol=1e-6)
    assert (plus.psi - centre.psi).std() == pytest.approx(0.05, rel=0.2)
    first, same, other = (requested(ses, Initialized(seed)) for seed in (1, 1, 2))
    assert first == same != other
    stored = make_se(cartpole)
    assert requested(centre, Centre()) is centre
    assert requested(stored, Centre()) is stored.se
    assert requested((stored, first), Given(0)) is stored.se
    assert requested((stored, first), Given(1)) is first
    assert requested_se(None, RealTask()) is None

    for source, on in (
        (centre, Given(0)),
        (ses, Given(0)),
        (None, Initialized(1)),
        (centre, Perturbed(1, 1)),
        ((stored, first), Given(2)),
        (None, Centre()),
    ):
        with pytest.raises(
            InvalidInput, match=rf"training on {type(on).__name__}.* is not possible"
        ):
            requested_se(source, on)


@pytest.mark.parametrize(
    ("scores", "expected"),
    [
        # The worst score of a task with penalties may be above all scores of agents.
        ([(-110.0, True), (0.0, False), (-50.0, True)], [-110.0, -110.0, -50.0]),
        ([(20.0, True), (0.0, False)], [20.0, 0.0]),
        ([(-3.0, False), (-3.0, False)], [-3.0, -3.0]),
    ],
)
def test_a_diverged_agent_never_ranks_above_others(
    scores: list[tuple[float, bool]], expected: list[float]
) -> None:
    outcomes = [EvaluationResult((score,), 100, 10, 7, finite, 0.5) for score, finite in scores]
    assert scores_of(outcomes).tolist() == expected
