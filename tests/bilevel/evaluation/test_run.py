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
    Initialized,
    Perturbed,
    RealTask,
    TrainedOn,
    evaluate,
    train_and_test,
)
from bilevel.hyperparameters import DDQNHyperparameters, Hyperparameters, default_agents
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task, get_task
from tests.conftest import ddqn
from tests.ses import around, make_se


def test_result_depends_on_the_request_alone(cartpole: Task, small_hp: Hyperparameters) -> None:
    ses = around(cartpole, small_hp)
    on: list[TrainedOn] = [
        Centre(),
        Perturbed(7, 1),
        Perturbed(7, -1),
        Initialized(3),
        RealTask(),
    ]
    requests = [EvaluationRequest(i, 100 + i, small_hp.agents[0], one) for i, one in enumerate(on)]
    forwards = [evaluate(cartpole, ses, r) for r in requests]
    np.random.seed(123)  # a global generator must not matter
    again = around(cartpole, small_hp)
    backwards = [evaluate(cartpole, again, r) for r in reversed(requests)]
    for one, two in zip(forwards, reversed(backwards), strict=True):
        assert replace(one, seconds=0.0) == replace(two, seconds=0.0)
    assert len({result.score for result in forwards}) > 1
    with ThreadPoolExecutor(len(on)) as pool:  # kernels release Python's lock
        together = list(pool.map(lambda request: evaluate(cartpole, ses, request), requests))
    for one, two in zip(forwards, together, strict=True):
        assert replace(one, seconds=0.0) == replace(two, seconds=0.0)


@pytest.mark.parametrize("seed", [None, -1, 1.5, "a"])
def test_a_request_needs_a_seed(seed: Any, cartpole: Task, small_hp: Hyperparameters) -> None:
    """Without one numpy would draw it, and the result would be another one each time."""
    request = EvaluationRequest(0, seed, small_hp.agents[0], RealTask())
    with pytest.raises(InvalidInput, match=rf"a seed is an integer of at least 0; got {seed!r}"):
        evaluate(cartpole, None, request)


def test_an_se_as_it_is_loaded(
    cartpole: Task, acrobot: Task, small_agent: DDQNHyperparameters
) -> None:
    stored, request = make_se(cartpole), EvaluationRequest(0, 1, small_agent)
    one, other = evaluate(cartpole, stored, request), evaluate(cartpole, stored.se, request)
    assert one.test_returns == other.test_returns
    with pytest.raises(InvalidInput, match="the SE has 4 state dimensions and 2 actions"):
        evaluate(acrobot, stored, request)


def test_steps_on_the_real_task_are_counted(cartpole: Task, small_hp: Hyperparameters) -> None:
    """On CartPole the return of an episode is its length; on Acrobot its length, or one less."""
    agent = replace(small_hp.agents[0], test_episodes=5)
    for compiled in (True, False):
        se = around(cartpole, small_hp).centre
        outcome = train_and_test(cartpole, se, agent, 3, compiled)
        assert outcome.real_env_steps == sum(outcome.test_returns)
        real = train_and_test(cartpole, None, agent, 3, compiled)
        assert real.real_env_steps == sum(real.test_returns) + real.train_steps
    gymnasium = replace(cartpole, dynamics=0)
    outcome = train_and_test(gymnasium, se, agent, 3)
    assert outcome.real_env_steps == sum(outcome.test_returns)
    acrobot = get_task("Acrobot-v1")
    outcome = train_and_test(acrobot, around(acrobot, small_hp).centre, agent, 3)
    ended = sum(value > -500 for value in outcome.test_returns)
    assert outcome.real_env_steps == -sum(outcome.test_returns) + ended


def test_divergence_scores_worst_and_is_told(acrobot: Task, small_hp: Hyperparameters) -> None:
    architecture = Architecture.of(acrobot, small_hp.se)
    psi = np.full(architecture.parameter_count, 1e20, np.float32)
    result = evaluate(acrobot, SE(architecture, psi), EvaluationRequest(0, 0, ddqn(small_hp)))
    assert not result.finite
    assert result.score == acrobot.worst_score == -500.0


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_an_se_that_is_no_number_scores_worst(
    wrong: float, acrobot: Task, small_hp: Hyperparameters
) -> None:
    architecture = Architecture.of(acrobot, small_hp.se)
    psi = architecture.initialize(np.random.default_rng(0))
    psi[::50] = wrong
    result = evaluate(acrobot, SE(architecture, psi), EvaluationRequest(0, 0, ddqn(small_hp)))
    assert (result.finite, result.score) == (False, -500.0)


@pytest.mark.parametrize("name", ["ddqn", "td3"])
def test_states_whose_sum_is_not_finite_are(
    name: str, cartpole: Task, small_hp: Hyperparameters
) -> None:
    """Agents that have not begun to learn train on them, as in the definition."""
    architecture = replace(Architecture.of(cartpole, small_hp.se), step_limit=4)
    psi = np.zeros(architecture.parameter_count, np.float32)
    next_state, *_ = architecture.split(psi)
    next_state[-4:-2] = 2e38  # of the output biases
    (agent,) = default_agents((name,))
    agent = replace(agent, max_episodes=3, init_episodes=3)
    for compiled in (True, False):
        outcome = train_and_test(cartpole, SE(architecture, psi), agent, 0, compiled)
        assert (outcome.finite, outcome.train_steps) == (True, 12)


def test_an_se_whose_episodes_never_end_is_bounded_by_the_step_limit(
    cartpole: Task, small_hp: Hyperparameters
) -> None:
    """With networks that output 0 no episode terminates. Step limit and number of episodes bound
    training, not time."""
    architecture = Architecture.of(cartpole, small_hp.se)
    psi = np.zeros(architecture.parameter_count, np.float32)
    agent = replace(ddqn(small_hp), early_out_episodes=1000)
    result = evaluate(cartpole, SE(architecture, psi), EvaluationRequest(0, 0, agent))
    assert result.train_episodes == agent.max_episodes
    assert result.train_steps == agent.max_episodes * cartpole.step_limit
    short = SE(replace(architecture, step_limit=41), psi)
    for compiled in (True, False):
        outcome = train_and_test(cartpole, short, agent, 0, compiled)
        assert outcome.train_steps == agent.max_episodes * 41


def test_the_real_task_keeps_its_step_limit(cartpole: Task, small_hp: Hyperparameters) -> None:
    """A policy that balances the pole, on an SE whose episodes are short."""
    architecture = replace(Architecture.of(cartpole, small_hp.se), step_limit=2)
    psi = architecture.initialize(np.random.default_rng(0))
    short = [
        train_and_test(cartpole, SE(architecture, psi), ddqn(small_hp), seed).test_returns
        for seed in range(3)
    ]
    assert max(map(max, short)) > architecture.step_limit == 2


def test_task_that_gymnasium_runs(small_hp: Hyperparameters) -> None:
    task = get_task("MountainCar-v0")
    request = EvaluationRequest(0, 3, small_hp.agents[0], Initialized(1))
    one, two = (evaluate(task, around(task, small_hp), request) for _ in range(2))
    assert replace(one, seconds=0.0) == replace(two, seconds=0.0)
    assert -200.0 <= one.score <= 0.0


def test_compiled_test_episodes_equal_gymnasiums(cartpole: Task, small_hp: Hyperparameters) -> None:
    """The same agents score the same on the compiled task and on gymnasium's, except for the
    initial states of the episodes."""
    architecture = Architecture.of(cartpole, small_hp.se)
    psi = architecture.initialize(np.random.default_rng(0))
    agent = replace(small_hp.agents[0], test_episodes=50)
    by_gymnasium = replace(cartpole, dynamics=0)
    compiled, real = (
        np.mean(train_and_test(task, SE(architecture, psi), agent, 5).test_returns)
        for task in (cartpole, by_gymnasium)
    )
    assert compiled == pytest.approx(real, abs=1.5)


def test_learning_on_the_real_task_is_possible(cartpole: Task) -> None:
    """DDQN with the paper's default hyperparameters learns CartPole on the real task."""
    agent = replace(load_recipe("paper", "").agents[0], max_episodes=300)
    assert any(train_and_test(cartpole, None, agent, seed).score > 150 for seed in range(5))


class Impatient(gymnasium.Env[Any, Any]):
    """A task that truncates its episodes itself, after five steps, and must not go on then."""

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


def test_training_heeds_a_tasks_own_truncation(
    small_agent: DDQNHyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = EnvSpec("test/Impatient-v0", entry_point=lambda **_: Impatient(), reward_threshold=99.0)
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    task = get_task(spec.id, step_limit=50)
    trained = train_and_test(task, None, small_agent, seed=0)
    assert trained.test_returns == (5.0, 5.0)
    assert trained.train_steps == 5 * trained.train_episodes == 5 * small_agent.max_episodes
