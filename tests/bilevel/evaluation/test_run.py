from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from bilevel.errors import InvalidInput
from bilevel.evaluation import (
    Centre,
    EvaluationRequest,
    EvaluationResult,
    Initialized,
    Perturbed,
    RealTask,
    TrainedOn,
    evaluate,
    train_and_test,
)
from bilevel.hyperparameters import (
    DDQNHyperparameters,
    Hyperparameters,
    default_agents,
    load_recipe,
)
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task, get_task
from tests.conftest import ddqn
from tests.ses import around, make_se


def untimed(result: EvaluationResult) -> EvaluationResult:
    return replace(result, seconds=0.0)


def test_a_result_depends_on_the_request_only(cartpole: Task, small_hp: Hyperparameters) -> None:
    ses = around(cartpole, small_hp)
    on: list[TrainedOn] = [
        Centre(),
        Perturbed(7, 1),
        Perturbed(7, -1),
        Initialized(3),
        RealTask(),
    ]
    requests = [
        EvaluationRequest(i, 100 + i, small_hp.agents[0], source) for i, source in enumerate(on)
    ]

    def run(request: EvaluationRequest) -> EvaluationResult:
        return untimed(evaluate(cartpole, ses, request))

    expected = [run(request) for request in requests]
    np.random.seed(123)  # a global generator must not matter
    ses = around(cartpole, small_hp)
    assert [run(request) for request in reversed(requests)] == expected[::-1]
    assert len({result.score for result in expected}) > 1
    with ThreadPoolExecutor(len(on)) as pool:  # kernels release Python's lock
        assert list(pool.map(run, requests)) == expected


@pytest.mark.parametrize("seed", [None, -1, 1.5, "a"])
def test_a_request_needs_a_seed(seed: Any, cartpole: Task, small_hp: Hyperparameters) -> None:
    request = EvaluationRequest(0, seed, small_hp.agents[0], RealTask())
    with pytest.raises(InvalidInput, match=rf"a seed is an integer of at least 0; got {seed!r}"):
        evaluate(cartpole, None, request)


def test_a_stored_se_is_evaluated_as_the_se(
    cartpole: Task, small_agent: DDQNHyperparameters
) -> None:
    stored, request = make_se(cartpole), EvaluationRequest(0, 1, small_agent)
    results = [evaluate(cartpole, se, request) for se in (stored, stored.se)]
    assert untimed(results[0]) == untimed(results[1])


def test_steps_on_the_real_task_are_counted(
    cartpole: Task, acrobot: Task, small_hp: Hyperparameters
) -> None:
    """On CartPole the return of an episode is its length; on Acrobot its length, or one less."""
    agent = replace(small_hp.agents[0], test_episodes=5)
    se = around(cartpole, small_hp).centre
    for task, compiled in (
        (cartpole, True),
        (cartpole, False),
        (replace(cartpole, dynamics=0), True),  # tests in gymnasium
    ):
        outcome = train_and_test(task, se, agent, 3, compiled)
        assert outcome.real_env_steps == sum(outcome.test_returns)
    for compiled in (True, False):
        real = train_and_test(cartpole, None, agent, 3, compiled)
        assert real.real_env_steps == sum(real.test_returns) + real.train_steps
    outcome = train_and_test(acrobot, around(acrobot, small_hp).centre, agent, 3)
    ended = sum(value > -500 for value in outcome.test_returns)
    assert outcome.real_env_steps == -sum(outcome.test_returns) + ended


@pytest.mark.parametrize("wrong", [1e20, np.nan, np.inf])
def test_divergence_scores_worst(wrong: float, acrobot: Task, small_hp: Hyperparameters) -> None:
    architecture = Architecture.of(acrobot, small_hp.se)
    psi = architecture.initialize(np.random.default_rng(0))
    psi[:: 1 if wrong == 1e20 else 50] = wrong
    result = evaluate(acrobot, SE(architecture, psi), EvaluationRequest(0, 0, ddqn(small_hp)))
    assert (result.finite, result.score) == (False, acrobot.worst_score)
    assert acrobot.worst_score == -500.0


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("name", ["ddqn", "td3"])
def test_finite_states_may_have_an_infinite_sum(
    name: str, compiled: bool, cartpole: Task, small_hp: Hyperparameters
) -> None:
    """Agents observe such states in their initial episodes."""
    architecture = replace(Architecture.of(cartpole, small_hp.se), step_limit=4)
    psi = np.zeros(architecture.parameter_count, np.float32)
    next_state, *_ = architecture.split(psi)
    next_state[-4:-2] = 2e38  # of the output biases
    (agent,) = default_agents((name,))
    agent = replace(agent, max_episodes=3, init_episodes=3)
    outcome = train_and_test(cartpole, SE(architecture, psi), agent, 0, compiled)
    assert (outcome.finite, outcome.train_steps) == (True, 12)


@pytest.mark.parametrize("compiled", [True, False])
def test_the_step_limit_ends_episodes_that_do_not_terminate(
    compiled: bool, cartpole: Task, small_hp: Hyperparameters
) -> None:
    """All outputs of this SE are 0."""
    architecture = replace(Architecture.of(cartpole, small_hp.se), step_limit=41)
    psi = np.zeros(architecture.parameter_count, np.float32)
    agent = replace(ddqn(small_hp), early_out_episodes=1000)
    outcome = train_and_test(cartpole, SE(architecture, psi), agent, 0, compiled)
    assert outcome.train_episodes == agent.max_episodes
    assert outcome.train_steps == agent.max_episodes * 41


def test_the_step_limit_of_an_se_does_not_apply_to_the_real_task(
    cartpole: Task, small_hp: Hyperparameters
) -> None:
    architecture = replace(Architecture.of(cartpole, small_hp.se), step_limit=2)
    se = SE(architecture, architecture.initialize(np.random.default_rng(0)))
    tests = [train_and_test(cartpole, se, ddqn(small_hp), seed).test_returns for seed in range(3)]
    assert np.max(tests) > architecture.step_limit == 2


def test_compiled_test_episodes_equal_gymnasiums(cartpole: Task, small_hp: Hyperparameters) -> None:
    """Except for the initial states of the episodes."""
    se = around(cartpole, small_hp).centre
    agent = replace(small_hp.agents[0], test_episodes=50)
    compiled, real = (
        train_and_test(task, se, agent, 5).score
        for task in (cartpole, replace(cartpole, dynamics=0))
    )
    assert compiled == pytest.approx(real, abs=1.5)


def test_ddqn_learns_cartpole_on_the_real_task(cartpole: Task) -> None:
    agent = replace(load_recipe("paper", "").agents[0], max_episodes=300)
    assert any(train_and_test(cartpole, None, agent, seed).score > 150 for seed in range(5))


class Truncating(gymnasium.Env[Any, Any]):
    """A task that truncates its episodes after five steps, and then accepts no further step."""

    observation_space = gymnasium.spaces.Box(-9.0, 9.0, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.steps = 0
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> Any:
        assert self.steps < 5
        self.steps += 1
        return np.full(1, self.steps, np.float32), 1.0, False, self.steps == 5, {}


def test_truncation_by_a_task_ends_episodes(
    small_agent: DDQNHyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = EnvSpec("test/Truncating-v0", lambda **_: Truncating(), reward_threshold=99.0)
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    task = get_task(spec.id, step_limit=50)
    outcome = train_and_test(task, None, small_agent, seed=0)
    assert outcome.test_returns == (5.0, 5.0)
    assert outcome.train_steps == 5 * outcome.train_episodes == 5 * small_agent.max_episodes
