import numpy as np
import pytest

from bilevel.errors import InvalidInput
from bilevel.evaluation import (
    Centre,
    Given,
    Initialized,
    Outcome,
    Perturbed,
    RealTask,
    scores_of,
)
from bilevel.evaluation.requests import requested_se
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from tests.ses import around, make_se


def test_what_a_request_asks_for(cartpole: Task, small_hp: Hyperparameters) -> None:
    ses = around(cartpole, small_hp)
    centre, plus, minus = (
        requested_se(ses, on) for on in (Centre(), Perturbed(7, 1), Perturbed(7, -1))
    )
    assert centre is not None
    assert plus is not None
    assert minus is not None
    np.testing.assert_allclose(plus.psi + minus.psi, 2 * centre.psi, atol=1e-6)
    assert (plus.psi - centre.psi).std() == pytest.approx(0.05, rel=0.2)
    one, same, other = (requested_se(ses, Initialized(seed)) for seed in (1, 1, 2))
    assert one is not None
    assert same is not None
    assert other is not None
    assert one.digest == same.digest != other.digest
    assert requested_se(ses, RealTask()) is None
    assert requested_se(centre, Centre()) is centre
    assert requested_se((one, centre), Given(1)) is centre
    for source in (centre, ses, None):
        with pytest.raises(InvalidInput, match=r"training on Given.* needs a tuple of SEs \("):
            requested_se(source, Given(0))
    for se in (None, centre):
        with pytest.raises(
            InvalidInput, match=r"training on Initialized.* needs a distribution of SEs"
        ):
            requested_se(se, Initialized(1))
    with pytest.raises(InvalidInput, match=r"training on Centre.* needs an SE or a distribution"):
        requested_se(None, Centre())


def test_a_given_se_is_one_of_those_there_are(cartpole: Task) -> None:
    ses = make_se(cartpole), make_se(cartpole, seed=1).se
    assert requested_se(ses, Given(0)) is ses[0].se
    assert requested_se(ses, Given(1)) is ses[1]
    for number in (-1, 2):
        with pytest.raises(InvalidInput, match="allowed are the SEs 0 to 1"):
            requested_se(ses, Given(number))


def outcome(score: float, finite: bool = True) -> Outcome:
    return Outcome((score,), 100, 10, 7, finite, 0.5)


def test_a_diverged_agent_does_not_outrank_others() -> None:
    """The worst score of a task with penalties may lie above all that agents get."""
    assert scores_of([outcome(-110.0), outcome(0.0, finite=False), outcome(-50.0)]).tolist() == [
        -110.0,
        -110.0,
        -50.0,
    ]
    assert scores_of([outcome(20.0), outcome(0.0, finite=False)]).tolist() == [20.0, 0.0]
    assert scores_of([outcome(-3.0, finite=False)] * 2).tolist() == [-3.0, -3.0]
