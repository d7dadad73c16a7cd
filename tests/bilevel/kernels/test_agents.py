"""Compiled agents against their torch definitions."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from bilevel.agents import get_agent
from bilevel.agents.agent import agent_seeds
from bilevel.agents.environments import KernelEnvironment, compiled_environment
from bilevel.agents.training import returns_converged, task_solved
from bilevel.agents.training import train as train_in_python
from bilevel.evaluation.run import schedule
from bilevel.hyperparameters import (
    ACTIVATIONS,
    AgentHyperparameters,
    default_agents,
)
from bilevel.kernels import td3_discrete, training
from bilevel.kernels.environment import Environment
from bilevel.kernels.training import NOT_FINITE, converged, solved
from bilevel.tasks import Task, get_task
from tests.ses import make_se

#: Agents with compiled twins, by name and whether their actions are continuous.
BUILT_IN = (
    *(("ddqn", False), ("dueling-ddqn", False), ("td3", False), ("td3", True)),
    *(("ppo", False), ("ppo", True)),
)
SEED = 3


def small(agent: str, **changes: Any) -> Any:
    """Small hyperparameters of a built-in agent."""
    (hp,) = default_agents((agent,))
    sizes: dict[str, Any] = {"max_episodes": 13, "init_episodes": 1, "batch_size": 16}
    sizes |= {"hidden_size": 8}
    sizes |= {"learning_rate": 1e-3, "test_episodes": 2, "rollout_steps": 40, "entropy": 0.01}
    known = {field.name for field in fields(hp)}
    return replace(hp, **{name: v for name, v in (sizes | changes).items() if name in known})


def twins(
    hp: AgentHyperparameters, n_states: int, action_size: int, continuous: bool = False
) -> tuple[Any, Any, Any]:
    """The definition, the kernel, and the kernel's random state."""
    registered = get_agent(hp.agent, continuous)
    initial, loop = agent_seeds(SEED)
    assert registered.build_kernel is not None
    kernel = registered.build_kernel(hp, n_states, action_size, np.random.default_rng(initial))
    definition = registered.build(hp, n_states, action_size, SEED)
    return definition, kernel, np.array([loop], np.uint64)


def largest_difference(definition: Any, kernel: Any) -> float:
    pairs = zip(kernel.parameters(), definition.parameters(), strict=True)
    return float(max(abs(k - d).max() for k, d in pairs))


@pytest.mark.parametrize("rho", [-1.0, 0.0, 1.0])
def test_hard_draws_follow_the_softmax(rho: float) -> None:
    """The largest component is action a with probability softmax(logits)_a at any temperature
    (Jang et al., 2017)."""
    logits = np.array([0.0, 1.0, -0.5], np.float32)
    columns = np.repeat(logits[:, np.newaxis], 20_000, axis=1)
    soft = np.zeros_like(columns)
    td3_discrete.relax(columns, np.float32(rho), 20_000, np.array([7], np.uint64), soft)
    np.testing.assert_allclose(soft.sum(axis=0), 1.0, atol=1e-5)
    frequencies = np.bincount(soft.argmax(axis=0), minlength=3) / 20_000
    np.testing.assert_allclose(frequencies, np.exp(logits) / np.exp(logits).sum(), atol=0.015)


def se_environment(task: Task, seed: int, episodes: int, step_limit: int) -> Environment:
    env = compiled_environment(task, make_se(task, seed=seed).se, episodes, seed + 1)
    return env._replace(step_limit=step_limit)


def difference_after_training(hp: Any, continuous: bool, seed: int) -> float:
    """The largest difference of the twins' parameters after the same training on an SE."""
    task = get_task("Pendulum-v1" if continuous else "CartPole-v0")
    env = se_environment(task, seed, hp.max_episodes, 25)
    definition, kernel, rng = twins(hp, task.state_size, task.action_size, continuous)
    start = [p.copy() for p in kernel.parameters()]
    in_python = KernelEnvironment(env, task.action_size, continuous)
    steps, episodes, finite = train_in_python(definition, hp, in_python, returns_converged(hp))
    compiled = training.train(kernel, env, schedule(hp), rng)
    assert finite
    assert compiled[:2] == (steps, episodes)
    assert steps > 100
    for before, after in zip(start, kernel.parameters(), strict=True):
        assert abs(after - before).max() > 1e-5  # every part has learned
    return largest_difference(definition, kernel)


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize(("agent", "continuous"), BUILT_IN)
def test_training_runs_agree(agent: str, continuous: bool, activation: str) -> None:
    """Exploration, replay, minibatches, updates, episode ends and stopping. A rounding error at a
    kink, or at a tie between actions, separates two runs permanently. This is rare, so most of
    three runs must agree."""
    depth = 1 + (ACTIVATIONS.index(activation) + 2 * continuous) % 3
    sizes = {"hidden_layers": depth, "hidden_size": 31, "batch_size": 24}
    hp = small(agent, max_episodes=20, replay_capacity=200, activation=activation, **sizes)
    differences = sorted(difference_after_training(hp, continuous, seed) for seed in range(3))
    assert differences[1] < 2e-4
    assert differences[2] < 0.05


@pytest.mark.parametrize("agent", ["ddqn", "dueling-ddqn", "td3"])
def test_non_finite_numbers_end_training(agent: str, cartpole: Task) -> None:
    hp = small(agent, learning_rate=1.0)
    env = se_environment(cartpole, 0, hp.max_episodes, 50)
    env.se.output_weights[:] = 1e30
    _, kernel, rng = twins(hp, 4, 2)
    assert training.train(kernel, env, schedule(hp), rng)[2] == NOT_FINITE

    env.se.output_biases[-1] = np.nan  # the done output
    assert training.train(kernel, env, schedule(hp), rng) == (0, 0, NOT_FINITE)


@pytest.mark.parametrize(
    ("returns", "init_episodes", "expected"),
    [
        (np.ones(15), 5, False),  # not before d episodes of learning
        (np.ones(16), 5, True),
        (np.repeat([100.0, 101.0], 10), 0, True),  # relative difference of two windows
        (np.repeat([100.0, 101.1], 10), 0, False),
        (np.full(20, -300.0), 0, True),
        (np.zeros(20), 0, True),
        (np.repeat([0.0, 1.0], 10), 0, False),
    ],
)
def test_training_on_an_se_stops_when_returns_have_converged(
    returns: Any, init_episodes: int, expected: bool
) -> None:
    hp = small("ddqn", init_episodes=init_episodes, early_out_episodes=10)
    assert converged(returns, schedule(hp)) == expected
    assert returns_converged(hp)(returns.tolist()) == expected


@pytest.mark.parametrize(
    ("episodes", "init_episodes", "solved_reward", "expected"),
    [(5, 2, 10.0, True), (5, 2, 10.7, False), (5, 5, 10.0, False), (2, 0, -1.0, False)],
)
def test_training_on_the_real_task_stops_when_it_is_solved(
    episodes: int, init_episodes: int, solved_reward: float, expected: bool
) -> None:
    """The rule reads the mean of the last three returns, after the initial episodes."""
    returns = np.array([0.0, 0.0, 10.0, 10.0, 12.0])[:episodes]
    hp = small("ddqn", init_episodes=init_episodes, early_out_episodes=3)
    assert solved(returns, schedule(hp), solved_reward) == expected
    assert task_solved(hp, solved_reward)(returns.tolist()) == expected
