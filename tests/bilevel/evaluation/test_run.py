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
    record,
    train_and_test,
)
from bilevel.evaluation.run import greedy_episodes
from bilevel.hyperparameters import DDQNHyperparameters, Hyperparameters
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task, get_task
from tests.conftest import ddqn
from tests.ses import around, make_se


def untimed(result: EvaluationResult) -> EvaluationResult:
    return replace(result, seconds=0.0)


def test_a_result_depends_on_the_request_only(cartpole: Task, small_hp: Hyperparameters) -> None:
    ses = around(cartpole, small_hp)
    on: list[TrainedOn] = [Centre(), Perturbed(7, 1), Perturbed(7, -1), Initialized(3), RealTask()]
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


class Gusty(gymnasium.Env[Any, Any]):
    """A task that draws a random number in every step, truncates its episodes after five steps, or
    two with action 1, and then accepts no further step."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.left = 5
        return self.np_random.standard_normal(1).astype(np.float32), {}

    def step(self, action: Any) -> Any:
        assert self.left > 0
        self.left -= 1 if action == 0 else 3
        state = self.np_random.standard_normal(1).astype(np.float32)
        return state, 1.0, False, self.left <= 0, {}


@pytest.fixture
def gusty(monkeypatch: pytest.MonkeyPatch) -> Task:
    spec = EnvSpec("test/Gusty-v0", lambda **_: Gusty(), reward_threshold=99.0)
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    return get_task(spec.id, step_limit=50)


def test_truncation_by_a_task_ends_episodes(gusty: Task, small_agent: DDQNHyperparameters) -> None:
    outcome = train_and_test(gusty, None, small_agent, seed=0)
    assert all(2 <= length <= 5 for length in outcome.test_returns)
    assert outcome.train_steps <= 5 * small_agent.max_episodes


def test_initial_states_do_not_depend_on_earlier_actions(gusty: Task) -> None:
    states = []
    for action, seed in ((0, 2**63 + 5), (1, 2**63 + 5), (0, 2**63 + 6)):
        episodes = greedy_episodes(gusty, lambda _, action=action: action, 4, seed)  # type: ignore[misc]
        states.append([float(episode[0].state[0]) for episode in episodes])
    assert states[0] == states[1] != states[2]
    assert len(set(states[0])) == 4


@pytest.mark.parametrize("task_id", ["CartPole-v0", "FrozenLake-v1"])
def test_a_recording_has_all_transitions(task_id: str, small_agent: DDQNHyperparameters) -> None:
    task = replace(get_task(task_id), step_limit=20)
    hp = replace(small_agent, init_episodes=3, max_episodes=5)
    training, tests = record(task, make_se(task).se, hp, 5)
    outcome = train_and_test(task, make_se(task).se, hp, 5, compiled=False)
    assert (len(training), len(tests)) == (outcome.train_steps, outcome.real_env_steps)
    total = sum(transition.reward for transition in tests)
    assert total / hp.test_episodes == pytest.approx(outcome.score)


@pytest.mark.parametrize("evaluate", [record, train_and_test])
def test_an_se_of_another_task_is_rejected(
    evaluate: Any, cartpole: Task, acrobot: Task, small_agent: DDQNHyperparameters
) -> None:
    with pytest.raises(InvalidInput, match="Acrobot-v1 has 6 state dimensions and 3 discr"):
        evaluate(acrobot, make_se(cartpole).se, small_agent, 5)
