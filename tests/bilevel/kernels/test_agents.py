"""Compiled agents against their torch definitions."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from bilevel.agents import get_agent
from bilevel.agents.agent import agent_seeds
from bilevel.agents.environments import KernelEnvironment
from bilevel.agents.training import returns_converged, task_solved
from bilevel.agents.training import train as train_in_python
from bilevel.evaluation.run import schedule
from bilevel.hyperparameters import (
    ACTIVATIONS,
    AgentHyperparameters,
    DDQNHyperparameters,
    SEHyperparameters,
    TD3Hyperparameters,
    default_agents,
)
from bilevel.kernels import ddqn, td3, training
from bilevel.kernels.environment import Environment, environment
from bilevel.kernels.stopping import CONVERGED, NOT_FINITE, converged, solved
from bilevel.splitmix import SplitMix64
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task

BUILT_IN = ("ddqn", "dueling-ddqn", "td3")
GRADIENT_STEPS = 300
SEED = 3


def small(agent: str, **changes: Any) -> Any:
    """Small hyperparameters of a built-in agent."""
    (hp,) = default_agents((agent,))
    sizes = {"max_episodes": 13, "init_episodes": 1, "batch_size": 16, "hidden_size": 8}
    return replace(hp, **(sizes | {"learning_rate": 1e-3, "test_episodes": 2} | changes))


def twins(hp: AgentHyperparameters, n_states: int, n_actions: int) -> tuple[Any, Any, Any]:
    """The definition, the kernel's agent, and the kernel's random state."""
    registered = get_agent(hp.agent)
    initial, loop = agent_seeds(SEED)
    assert registered.build_kernel is not None
    kernel = registered.build_kernel(hp, n_states, n_actions, np.random.default_rng(initial))
    definition = registered.build(hp, n_states, n_actions, SEED)
    return definition, kernel, np.array([loop], np.uint64)


def parameters(agent: Any, kernel: Any) -> list[NDArray[np.float32]]:
    registered = get_agent(agent)
    assert registered.kernel_parameters is not None
    return registered.kernel_parameters(kernel)


def largest_difference(definition: Any, kernel: Any, agent: str) -> float:
    pairs = zip(parameters(agent, kernel), definition.parameters(), strict=True)
    return float(max(abs(k - d).max() for k, d in pairs))


def difference_after_gradient_steps(agent: str, hp: Any, data_seed: int) -> float:
    """Differences of all parameters of the twins, after the same minibatches."""
    definition, kernel, rng = twins(hp, 5, 3)
    start = [p.copy() for p in parameters(agent, kernel)]
    data, size = np.random.default_rng(data_seed), hp.batch_size
    for step in range(1, GRADIENT_STEPS + 1):
        states = data.normal(0, 1, (size, 5)).astype(np.float32)
        next_states = data.normal(0, 1, (size, 5)).astype(np.float32)
        rewards = data.normal(0, 1, size).astype(np.float32)
        dones = data.normal(0, 0.3, size).astype(np.float32)  # raw, not only 0 and 1
        if agent == "td3":
            actions = data.normal(0.3, 0.4, (size, 3)).astype(np.float32)
        else:
            actions = data.integers(0, 3, (size, 1)).astype(np.float32)
        batch = kernel.batch
        batch.states[:, :size], batch.next_states[:, :size] = states.T, next_states.T
        batch.rewards[:], batch.dones[:], batch.actions[:, :size] = rewards, dones, actions.T
        module = td3 if agent == "td3" else ddqn
        loss = module.gradient_step(kernel, rng)
        arrays = (states, actions, rewards, next_states, dones)
        expected = definition.gradient_step(*(torch.from_numpy(array) for array in arrays))
        if step < 10:
            assert loss == pytest.approx(expected, rel=2e-5)
    for before, after in zip(start, parameters(agent, kernel), strict=True):
        assert abs(after - before).max() > 1e-4  # every part has learned
    return largest_difference(definition, kernel, agent)


@pytest.mark.parametrize(
    ("agent", "activation", "hidden_layers"),
    # Each case compiles again, so not all combinations of agent, activation and depth are tested.
    [
        (agent, activation, 1 + (i + j) % 3)
        for i, agent in enumerate(BUILT_IN)
        for j, activation in enumerate(ACTIVATIONS)
        if (i + j) % 2 == 0
    ],
)
def test_parameters_hold_together_over_hundreds_of_gradient_steps(
    agent: str, activation: str, hidden_layers: int
) -> None:
    """A rounding error at a kink, or at a tie between actions, makes two runs diverge for good.
    This is rare, so most of three runs must agree."""
    hp = small(
        agent,
        activation=activation,
        hidden_layers=hidden_layers,
        hidden_size=31,
        batch_size=24,
    )
    differences = sorted(difference_after_gradient_steps(agent, hp, seed) for seed in (9, 10, 11))
    assert differences[1] < 1e-4
    assert differences[2] < 0.05


def test_a_prelu_slope_is_learned() -> None:
    for agent in BUILT_IN:
        hp = small(agent, activation="prelu")
        _definition, kernel, rng = twins(hp, 4, 2)
        kernel.batch.states[:] = np.random.default_rng(0).normal(0, 1, kernel.batch.states.shape)
        for _ in range(4):
            (td3 if agent == "td3" else ddqn).gradient_step(kernel, rng)
        assert all(p[-1] != 0.25 for p in parameters(agent, kernel) if p.size > 1)


def test_the_value_of_a_dueling_network_is_shared_by_all_actions() -> None:
    """The mean advantage is subtracted: adding to all advantage biases changes nothing."""
    _, kernel, _ = twins(small("dueling-ddqn"), 4, 3)
    states = np.random.default_rng(0).normal(0, 1, kernel.batch.states.shape).astype(np.float32)
    before, after = np.zeros_like(kernel.q), np.zeros_like(kernel.q)
    ddqn.action_values(kernel, kernel.theta, states, kernel.h, kernel.z, before)
    kernel.theta[-3:] += 1.0  # biases of the advantages
    ddqn.action_values(kernel, kernel.theta, states, kernel.h, kernel.z, after)
    np.testing.assert_allclose(after, before, atol=1e-6)
    kernel.theta[kernel.net.offsets[4] - 1] += 1.0  # bias of the value
    ddqn.action_values(kernel, kernel.theta, states, kernel.h, kernel.z, after)
    np.testing.assert_allclose(after, before + 1.0, atol=1e-6)


class TestGumbelSoftmax:
    def test_hard_draws_follow_the_softmax(self) -> None:
        """The largest component is action a with probability softmax(logits)_a,
        whatever the temperature (Jang et al., 2017)."""
        logits = np.array([0.0, 1.0, -0.5], np.float32)
        expected = np.exp(logits) / np.exp(logits).sum()
        n = 20_000
        for rho in (-1.0, 0.0, 1.0):
            drawn = np.repeat(logits[:, np.newaxis], n, axis=1)
            soft = np.zeros_like(drawn)
            td3.relax(drawn, np.float32(rho), n, np.array([7], np.uint64), soft)
            np.testing.assert_allclose(soft.sum(axis=0), 1.0, atol=1e-5)
            frequencies = np.bincount(soft.argmax(axis=0), minlength=3) / n
            np.testing.assert_allclose(frequencies, expected, atol=0.015)

    def test_it_hardens_as_the_temperature_falls(self) -> None:
        sharpness = []
        for rho in (1.0, 0.0, -2.0):
            logits = np.zeros((3, 1000), np.float32)
            soft = np.zeros_like(logits)
            td3.relax(logits, np.float32(rho), 1000, np.array([7], np.uint64), soft)
            sharpness.append(soft.max(axis=0).mean())
        assert sharpness == sorted(sharpness)
        assert sharpness[-1] > 0.9

    def test_the_temperature_stays_in_its_bounds(self) -> None:
        """From beyond them, one step takes it back."""
        for bound, beyond in zip(TD3Hyperparameters.temperatures, (-1.0, 1.0), strict=True):
            _, kernel, rng = twins(small("td3", learning_rate=1e-6), 4, 2)
            kernel.rho.online[0] = np.log(bound) + beyond
            td3.actor_step(kernel, rng)
            assert np.exp(kernel.rho.online[0]) == pytest.approx(bound)


def se_environment(task: Task, seed: int, episodes: int, step_limit: int) -> Environment:
    se_hp = SEHyperparameters(
        structure="plain",
        hidden_layers=1,
        hidden_size=16,
        activation="lrelu",
        step_limit=0,
        spread=1.0,
    )
    architecture = Architecture.of(task, se_hp)
    psi = architecture.initialize(np.random.default_rng(seed))
    physics = task.initial_physics(np.random.default_rng(seed + 1), episodes)
    se = SE(architecture, psi).kernel
    return environment(
        se, True, task.dynamics, task.state_size, step_limit, task.solved_reward, physics
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("agent", BUILT_IN)
def test_whole_training_runs_are_the_same(seed: int, agent: str, cartpole: Task) -> None:
    """With the same random numbers exploration, replay, minibatches, updates, episode ends and
    stopping of both twins agree."""
    hp = small(agent, max_episodes=20, replay_capacity=200)
    env = se_environment(cartpole, seed, hp.max_episodes, 25)
    definition, kernel, rng = twins(hp, 4, 2)
    steps, episodes, finite = train_in_python(
        definition, hp, KernelEnvironment(env), returns_converged(hp)
    )
    compiled = training.train(kernel, env, schedule(hp), rng)
    assert finite
    assert compiled[:2] == (steps, episodes)
    assert steps > 100
    assert largest_difference(definition, kernel, agent) < 2e-4


@pytest.mark.parametrize("agent", BUILT_IN)
def test_diverging_numbers_end_training(agent: str, cartpole: Task) -> None:
    hp = small(agent, learning_rate=1.0)
    env = se_environment(cartpole, 0, hp.max_episodes, 50)
    env.se.output_weights[:] = 1e30
    _, kernel, rng = twins(hp, 4, 2)
    assert training.train(kernel, env, schedule(hp), rng)[2] == NOT_FINITE


@pytest.mark.parametrize("agent", BUILT_IN)
def test_nan_in_the_se_ends_training(agent: str, cartpole: Task) -> None:
    hp = small(agent)
    env = se_environment(cartpole, 0, hp.max_episodes, 50)
    env.se.output_biases[-1] = np.nan  # the done output
    _, kernel, rng = twins(hp, 4, 2)
    assert training.train(kernel, env, schedule(hp), rng) == (0, 0, NOT_FINITE)


class TestStoppingRule:
    def test_not_before_d_episodes_of_learning(self) -> None:
        returns = np.ones(100)
        assert not converged(returns, 14, 5, 10, 0.01)
        assert converged(returns, 15, 5, 10, 0.01)

    def test_relative_difference_of_the_two_windows(self) -> None:
        returns = np.concatenate([np.full(10, 100.0), np.full(10, 101.0)])
        assert converged(returns, 19, 0, 10, 0.01)
        returns[10:] = 101.1
        assert not converged(returns, 19, 0, 10, 0.01)

    def test_negative_returns_and_zero(self) -> None:
        assert converged(np.full(20, -300.0), 19, 0, 10, 0.01)
        assert converged(np.zeros(20), 19, 0, 10, 0.01)
        zero_then_one = np.concatenate([np.zeros(10), np.ones(10)])
        assert not converged(zero_then_one, 19, 0, 10, 0.01)


@pytest.mark.parametrize("init_episodes", [0, 3])
@pytest.mark.parametrize("window", [1, 4])
def test_both_twins_of_the_stopping_rules_agree(init_episodes: int, window: int) -> None:
    hp = small("ddqn", init_episodes=init_episodes, early_out_episodes=window)
    hp = replace(hp, early_out_difference=0.1)
    on_se, on_task = returns_converged(hp), task_solved(hp, 10.0)
    rng, ended = np.random.default_rng(0), 0
    for _ in range(200):
        returns = rng.normal(10, 1.5, int(rng.integers(1, 14)))
        last = returns.size - 1
        expected = converged(returns, last, init_episodes, window, 0.1)
        assert on_se(returns.tolist()) == expected
        assert on_task(returns.tolist()) == solved(returns, last, init_episodes, window, 10.0)
        ended += expected
    assert 20 < ended < 180


def test_training_on_the_real_task_stops_when_solved() -> None:
    """With a solved reward that every agent reaches, training stops at once."""
    task = Task("CartPole-v0", 4, 2, 200, 1.0, 0.0, 1)
    env = se_environment(task, 0, 10, 200)._replace(synthetic=False)
    hp: DDQNHyperparameters = small("ddqn", init_episodes=2)
    _, kernel, rng = twins(hp, 4, 2)
    _, episodes, outcome = training.train(kernel, env, schedule(hp), rng)
    assert outcome == CONVERGED
    assert episodes == hp.early_out_episodes  # a mean of fewer does not count


def test_solved_is_a_mean_of_the_last_d_episodes() -> None:
    returns = np.array([0.0, 0.0, 10.0, 10.0, 12.0])
    assert solved(returns, 4, 2, 3, 10.0)
    assert not solved(returns, 4, 2, 3, 10.7)
    assert not solved(returns, 4, 5, 3, 10.0)  # initial episodes
    assert not solved(returns, 1, 0, 3, -1.0)  # too few


@pytest.mark.parametrize("name", ["gumbel", "normal"])
def test_the_definition_draws_the_same_noise(name: str) -> None:
    from bilevel.kernels import random

    state = np.array([5], np.uint64)
    compiled = [getattr(random, name)(state) for _ in range(500)]
    drawn = getattr(SplitMix64(5), name)(500)
    np.testing.assert_allclose(drawn, compiled, rtol=1e-6)
    mean, spread = {"gumbel": (0.577, np.pi / 6**0.5), "normal": (0.0, 1.0)}[name]
    assert drawn.mean() == pytest.approx(mean, abs=0.15)
    assert drawn.std() == pytest.approx(spread, rel=0.1)
