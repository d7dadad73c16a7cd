"""TrainAgent and EvaluateAgent (paper, Algorithm 1), compiled, for every compiled agent.

An agent is a `Kernel`. Its module implements the functions `act`,
`greedy`, `learn` and `end_episode` for this type with `implements`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from bilevel.kernels.environment import reset, step
from bilevel.kernels.jit import OPTIONS, all_finite, compiled, is_finite
from bilevel.kernels.replay import store

#: Reasons why training ended; CONVERGED is also that of a solved real task.
CONVERGED, EPISODES_SPENT, NOT_FINITE = 0, 1, 2


class Kernel(Protocol):
    """The compiled twin of an agent: a NamedTuple with the field `action` (M,), the last action as
    the memory stores it."""

    def parameters(self) -> list[NDArray[np.float32]]:
        """All parameters, in the order of the definition's `parameters`."""


class Schedule(NamedTuple):
    """Length of an agent's training (see `AgentHyperparameters`)."""

    init_episodes: int
    max_episodes: int
    early_out_episodes: int
    early_out_difference: float
    replay_capacity: int


def act(agent, state, exploring, rng):
    """Choose a training action in `state` (S,); `exploring` is true in the initial episodes."""


def greedy(agent, state):
    """Choose the action in tests in `state` (S,)."""


def learn(agent, memory, steps, rng):
    """Learn from the memory (`bilevel.kernels.replay`) after `steps` transitions; return the loss,
    0 if there is none."""


def end_episode(agent):
    """Handle the end of a training episode."""


def implements(agent_type: type, call: Callable[..., Any]) -> Callable[[Any], Any]:
    """Decorator: register a kernel as the implementation of `call` for an agent type.

    The compiler gets the kernel's source: a call of the compiled kernel would be a separate
    function, optimised once more before it is inlined.
    """

    def register(kernel: Any) -> Any:
        def resolve(agent: Any, *others: Any) -> Callable[..., Any] | None:
            named = isinstance(agent, (types.NamedTuple, types.NamedUniTuple))
            return kernel.py_func if named and agent.instance_class is agent_type else None

        overload(call, jit_options=OPTIONS, strict=False)(resolve)
        return kernel

    return register


@compiled
def converged(returns, schedule):
    """The rule `returns_converged` of `bilevel.agents.training`, given the returns so far."""
    d = schedule.early_out_episodes
    if returns.size <= schedule.init_episodes + d:
        return False
    recent, earlier = returns[-d:].mean(), returns[-2 * d : -d].mean()
    return abs(recent - earlier) <= schedule.early_out_difference * abs(earlier)


@compiled
def solved(returns, schedule, solved_reward):
    """The rule `task_solved` of `bilevel.agents.training`, given the returns so far."""
    d = schedule.early_out_episodes
    if returns.size <= schedule.init_episodes or returns.size < d:
        return False
    return returns[-d:].mean() >= solved_reward


@compiled
def train(agent, env, schedule, rng):
    """`bilevel.agents.training.train`, compiled: train on `env` until its stopping rule holds, a
    value is not finite, or all episodes were run.

    Returns environment steps, episodes and the reason of the end.
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
            if not exploring and not is_finite(learn(agent, memory, steps, rng)):
                return steps, episode, NOT_FINITE
            if over:
                break
        end_episode(agent)
        so_far = returns[: episode + 1]
        if env.synthetic:
            stop = converged(so_far, schedule)
        else:
            stop = solved(so_far, schedule, env.solved_reward)
        if stop:
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
    """Call `greedy` from Python."""
    return greedy(agent, state)
