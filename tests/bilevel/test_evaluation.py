from dataclasses import replace

import numpy as np
import pytest

from bilevel.evaluation import EvaluationRequest, evaluate, request_psi, train_and_test
from bilevel.hyperparameters import Hyperparameters
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task, get_task
from tests.conftest import ddqn


@pytest.fixture
def architecture(cartpole: Task, small_hp: Hyperparameters) -> Architecture:
    return Architecture.of(cartpole, small_hp.se)


def test_result_depends_on_the_request_alone(
    cartpole: Task, architecture: Architecture, small_hp: Hyperparameters
) -> None:
    psi = architecture.initialize(np.random.default_rng(0))
    requests = [
        EvaluationRequest(i, 100 + i, small_hp.agents[0], sign, 7, 0.05)
        for i, sign in enumerate((0, 1, -1, 1))
    ]
    forwards = [evaluate(cartpole, architecture, psi, r) for r in requests]
    np.random.seed(123)  # a global generator must not matter
    backwards = [evaluate(cartpole, architecture, psi.copy(), r) for r in reversed(requests)]
    for one, two in zip(forwards, reversed(backwards), strict=True):
        assert replace(one, seconds=0.0) == replace(two, seconds=0.0)
    assert len({result.score for result in forwards}) > 1


def test_signs_mirror_each_other(architecture: Architecture, small_hp: Hyperparameters) -> None:
    psi = architecture.initialize(np.random.default_rng(0))
    plus, minus, none = (
        request_psi(architecture, psi, EvaluationRequest(0, 0, small_hp.agents[0], sign, 7, 0.05))
        for sign in (1, -1, 0)
    )
    np.testing.assert_array_equal(none, psi)
    np.testing.assert_allclose(plus + minus, 2 * psi, atol=1e-6)
    assert (plus - psi).std() == pytest.approx(0.05, rel=0.2)


def test_divergence_scores_worst_and_is_told(acrobot: Task, small_hp: Hyperparameters) -> None:
    architecture = Architecture.of(acrobot, small_hp.se)
    psi = np.full(architecture.parameter_count, 1e20, np.float32)
    result = evaluate(acrobot, architecture, psi, EvaluationRequest(0, 0, small_hp.agents[0]))
    assert not result.finite
    assert result.score == acrobot.worst_score == -500.0


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_an_se_that_is_no_number_scores_worst(
    wrong: float, acrobot: Task, small_hp: Hyperparameters
) -> None:
    architecture = Architecture.of(acrobot, small_hp.se)
    psi = architecture.initialize(np.random.default_rng(0))
    psi[::50] = wrong
    result = evaluate(acrobot, architecture, psi, EvaluationRequest(0, 0, ddqn(small_hp)))
    assert (result.finite, result.score) == (False, -500.0)


def test_an_se_whose_episodes_never_end_is_bounded_by_the_step_limit(
    cartpole: Task, small_hp: Hyperparameters
) -> None:
    """All networks answer 0: no episode is ever done, and no reward lets an agent stop
    early for having learned; steps bound it, whatever the clock says."""
    architecture = Architecture.of(cartpole, small_hp.se)
    psi = np.zeros(architecture.parameter_count, np.float32)
    agent = replace(ddqn(small_hp), early_out_episodes=1000)
    result = evaluate(cartpole, architecture, psi, EvaluationRequest(0, 0, agent))
    assert result.train_episodes == agent.max_episodes
    assert result.train_steps == agent.max_episodes * cartpole.step_limit
    short = replace(architecture, step_limit_share=0.203)
    assert short.step_limit(cartpole) == 41
    for compiled in (True, False):
        outcome = train_and_test(cartpole, (short, psi), agent, 0, compiled)
        assert outcome.train_steps == agent.max_episodes * 41


def test_the_real_task_keeps_its_step_limit(cartpole: Task, small_hp: Hyperparameters) -> None:
    """A policy that balances the pole, on an SE whose episodes are short."""
    architecture = replace(Architecture.of(cartpole, small_hp.se), step_limit_share=0.01)
    psi = architecture.initialize(np.random.default_rng(0))
    short = [
        train_and_test(cartpole, (architecture, psi), ddqn(small_hp), seed).test_returns
        for seed in range(3)
    ]
    assert max(map(max, short)) > architecture.step_limit(cartpole) == 2


def test_task_that_gymnasium_runs(small_hp: Hyperparameters) -> None:
    task = get_task("MountainCar-v0")
    architecture = Architecture.of(task, small_hp.se)
    request = EvaluationRequest(0, 3, small_hp.agents[0], start_seed=1)
    one, two = (evaluate(task, architecture, None, request) for _ in range(2))
    assert replace(one, seconds=0.0) == replace(two, seconds=0.0)
    assert -200.0 <= one.score <= 0.0


def test_compiled_test_episodes_equal_gymnasiums(cartpole: Task, small_hp: Hyperparameters) -> None:
    """The same agents score the same on the compiled task and on gymnasium's,
    up to the episodes' initial states."""
    architecture = Architecture.of(cartpole, small_hp.se)
    psi = architecture.initialize(np.random.default_rng(0))
    agent = replace(small_hp.agents[0], test_episodes=50)
    by_gymnasium = replace(cartpole, dynamics=0)
    compiled, real = (
        np.mean(train_and_test(task, (architecture, psi), agent, 5).test_returns)
        for task in (cartpole, by_gymnasium)
    )
    assert compiled == pytest.approx(real, abs=1.5)


def test_learning_on_the_real_task_is_possible(cartpole: Task) -> None:
    """DDQN with the paper's default hyperparameters does learn CartPole itself."""
    from bilevel.hyperparameters import load_preset

    agent = replace(load_preset("default", "CartPole-v0").agents[0], max_episodes=300)
    outcomes = [train_and_test(cartpole, None, agent, seed) for seed in range(2)]
    assert max(np.mean(outcome.test_returns) for outcome in outcomes) > 150
