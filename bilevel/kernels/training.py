"""TrainAgent and EvaluateAgent (paper, Algorithm 1), compiled, for every compiled agent.

An agent is a NamedTuple of its parameters and work space, with the fields `batch` (`replay.Batch`)
and `action` ((M,) float32: the last action, as the replay buffer stores it). The agent's module
registers implementations of the functions below for this type with `implements`; the compiler
resolves the calls, so that training looks nothing up.

    act(agent, state, exploring, rng)   returns a training action; `exploring` is true in the
                                        initial episodes
    greedy(agent, state)                returns the action in tests
    learn(agent, rng)                   makes a gradient step on `agent.batch`, returns the loss
    end_episode(agent)                  handles the end of a training episode
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from bilevel.kernels.environment import reset, step
from bilevel.kernels.jit import OPTIONS, all_finite, compiled, is_finite
from bilevel.kernels.replay import sample, store
from bilevel.kernels.stopping import CONVERGED, EPISODES_SPENT, NOT_FINITE, converged, solved


class Schedule(NamedTuple):
    """Length of an agent's training (see `AgentHyperparameters`)."""

    init_episodes: int
    max_episodes: int
    early_out_episodes: int
    early_out_difference: float
    replay_capacity: int


def act(agent: Any, state: Any, exploring: Any, rng: Any) -> Any:
    """Choose a training action in `state` (S,)."""
    raise NotImplementedError


def greedy(agent: Any, state: Any) -> Any:
    """Choose the action in tests in `state` (S,)."""
    raise NotImplementedError


def learn(agent: Any, rng: Any) -> Any:
    """Make one gradient step on `agent.batch`; return the loss."""
    raise NotImplementedError


def end_episode(agent: Any) -> Any:
    """Handle the end of a training episode."""
    raise NotImplementedError


def implements(
    agent_type: type, call: Callable[..., Any]
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator: register a kernel, with the parameters of `call`, as its implementation for an
    agent type.

    The compiler gets the kernel's source: a call of the compiled kernel would be a function of its
    own, optimised once more before it is inlined.
    """

    def register(kernel: Any) -> Callable[..., Any]:
        def resolve(agent: Any, *others: Any) -> Callable[..., Any] | None:
            named = isinstance(agent, (types.NamedTuple, types.NamedUniTuple))
            source: Callable[..., Any] = kernel.py_func
            return source if named and agent.instance_class is agent_type else None

        overload(call, jit_options=OPTIONS, strict=False)(resolve)
        return kernel  # type: ignore[no-any-return]

    return register


@compiled
def train(agent, env, schedule, rng):
    """Train on `env` until its stopping rule holds or all episodes were run.

    for each episode:                            # at most max_episodes
        for each step:                           # at most step_limit
            act, store the transition
            gradient step                        # once init_episodes are over
        stop on an SE: returns have converged
        stop on the real task: mean return reaches the solved reward

    Returns environment steps, episodes and the reason of the end (see `stopping`).
    """
    n_states = env.state_size
    state = np.zeros(n_states, np.float32)
    next_state = np.zeros(n_states, np.float32)
    capacity = min(schedule.replay_capacity, schedule.max_episodes * env.step_limit)
    memory = np.empty((capacity, 2 * n_states + 2 + agent.action.size), np.float32)
    returns = np.zeros(schedule.max_episodes)
    steps = 0

    for episode in range(schedule.max_episodes):
        exploring = episode < schedule.init_episodes
        reset(env, episode, state)
        for _ in range(env.step_limit):
            action = act(agent, state, exploring, rng)
            reward, done, over = step(env, state, action, next_state)
            if not (is_finite(reward) and is_finite(done) and all_finite(next_state)):
                return steps, episode, NOT_FINITE
            store(memory, steps, state, agent.action, next_state, reward, done)
            state[:] = next_state
            steps += 1
            returns[episode] += reward
            if not exploring:
                sample(memory, steps, rng, agent.batch)
                if not is_finite(learn(agent, rng)):
                    return steps, episode, NOT_FINITE
            if over:
                break
        end_episode(agent)
        if env.synthetic:
            if converged(
                returns,
                episode,
                schedule.init_episodes,
                schedule.early_out_episodes,
                schedule.early_out_difference,
            ):
                return steps, episode + 1, CONVERGED
        elif solved(
            returns,
            episode,
            schedule.init_episodes,
            schedule.early_out_episodes,
            env.solved_reward,
        ):
            return steps, episode + 1, CONVERGED
    return steps, schedule.max_episodes, EPISODES_SPENT


@compiled
def test_returns(agent, env, episodes):
    """EvaluateAgent: returns (episodes,) of greedy episodes on the compiled real task, and their
    number of steps."""
    state = np.zeros(env.state_size, np.float32)
    next_state = np.zeros(env.state_size, np.float32)
    returns = np.zeros(episodes)
    steps = 0
    for episode in range(episodes):
        reset(env, episode, state)
        for _ in range(env.step_limit):
            reward, _, over = step(env, state, greedy(agent, state), next_state)
            returns[episode] += reward
            steps += 1
            if over:
                break
            state[:] = next_state
    return returns, steps


@compiled
def greedy_action(agent, state):
    """The function `greedy`, for callers in Python."""
    return greedy(agent, state)
