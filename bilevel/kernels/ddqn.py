"""Double DQN, compiled: the twin of `bilevel.agents.ddqn`, which defines it.

Both draw the same numbers from the same generator in the same order, so a
whole training run can be held side by side.

symbol   shape            meaning
------   --------------   -----------------------------------------
theta    (P,) float32     parameters of the Q-network
target   (P,) float32     parameters of the target network
B, A     -                batch size, number of actions
B'       -                batch size, padded to whole vector registers; the added
                          samples have zero inputs and no part in the loss
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.kernels import dynamics
from bilevel.kernels.adam import adam_step, soft_update
from bilevel.kernels.jit import compiled, is_finite
from bilevel.kernels.mlp import Network, backward, forward, forward_single, padded
from bilevel.kernels.random import below, uniform
from bilevel.kernels.replay import sample, store
from bilevel.kernels.stopping import CONVERGED, EPISODES_SPENT, NOT_FINITE, converged
from bilevel.kernels.synthetic_env import SEKernel
from bilevel.kernels.synthetic_env import step as se_step


class Settings(NamedTuple):
    """Hyperparameters as the kernel takes them (see `DDQNHyperparameters`)."""

    init_episodes: int
    batch_size: int
    learning_rate: float
    target_update_rate: float
    discount: float
    initial_epsilon: float
    minimal_epsilon: float
    epsilon_decay: float
    replay_capacity: int
    max_episodes: int
    early_out_episodes: int
    early_out_difference: float
    test_episodes: int


class Environment(NamedTuple):
    """What an agent trains on: an SE, or the compiled real task."""

    synthetic: bool
    se: SEKernel  # read only if synthetic
    dynamics: int  # code of `bilevel.kernels.dynamics`
    state_size: int
    step_limit: int
    solved_reward: float  # read only if not synthetic
    initial_physics: NDArray[np.float64]  # (episodes, p); episode e starts in row e


class Learner(NamedTuple):
    """The agent's memory: parameters, optimiser, and a batch of work space."""

    net: Network
    theta: NDArray[np.float32]
    target: NDArray[np.float32]
    gradient: NDArray[np.float32]
    first: NDArray[np.float32]  # Adam's moments
    second: NDArray[np.float32]
    states: NDArray[np.float32]  # (S, B')
    next_states: NDArray[np.float32]  # (S, B')
    rewards: NDArray[np.float32]  # (B,)
    dones: NDArray[np.float32]  # (B,)
    actions: NDArray[np.int64]  # (B,)
    h: NDArray[np.float32]  # (depth, H, B') of the states
    z: NDArray[np.float32]
    h_next: NDArray[np.float32]  # (depth, H, B') of the next states
    z_next: NDArray[np.float32]
    delta_h: NDArray[np.float32]
    q: NDArray[np.float32]  # (A, B')
    q_next: NDArray[np.float32]
    q_target: NDArray[np.float32]
    delta_q: NDArray[np.float32]


def new_learner(net: Network, theta: NDArray[np.float32], batch_size: int) -> Learner:
    """A learner that starts from `theta` (copied)."""
    n_in, hidden, n_out = int(net.sizes[0]), int(net.sizes[1]), int(net.sizes[-1])
    depth = net.sizes.size - 2

    def batch(*shape: int) -> NDArray[np.float32]:
        return np.zeros((*shape, padded(batch_size)), np.float32)

    return Learner(
        net,
        theta.copy(),
        theta.copy(),
        np.zeros_like(theta),
        np.zeros_like(theta),
        np.zeros_like(theta),
        batch(n_in),
        batch(n_in),
        np.zeros(batch_size, np.float32),
        np.zeros(batch_size, np.float32),
        np.zeros(batch_size, np.int64),
        batch(depth, hidden),
        batch(depth, hidden),
        batch(depth, hidden),
        batch(depth, hidden),
        batch(depth, hidden),
        batch(n_out),
        batch(n_out),
        batch(n_out),
        batch(n_out),
    )


@compiled
def gradient_step(learner, step, learning_rate, discount, target_update_rate):
    """One gradient step on the minibatch in `learner`; return the mean squared error.

    The online network chooses the next action, the target network values it
    (van Hasselt et al., 2016); the raw done output weighs the future.
    """
    net = learner.net
    q, q_next, q_target, delta_q = learner.q, learner.q_next, learner.q_target, learner.delta_q
    forward(net, learner.theta, learner.next_states, learner.h_next, learner.z_next, q_next)
    forward(net, learner.target, learner.next_states, learner.h_next, learner.z_next, q_target)
    forward(net, learner.theta, learner.states, learner.h, learner.z, q)
    n_actions, batch_size = q.shape[0], learner.rewards.size
    gamma, one = np.float32(discount), np.float32(1)
    scale = np.float32(2.0 / batch_size)
    loss = np.float32(0)
    for i in range(batch_size):
        best = 0
        for a in range(1, n_actions):
            if q_next[a, i] > q_next[best, i]:
                best = a
            delta_q[a, i] = 0
        delta_q[0, i] = 0
        goal = learner.rewards[i] + gamma * q_target[best, i] * (one - learner.dones[i])
        action = learner.actions[i]
        error = q[action, i] - goal
        delta_q[action, i] = scale * error
        loss += error * error
    backward(
        net,
        learner.theta,
        learner.states,
        learner.h,
        learner.z,
        delta_q,
        learner.delta_h,
        learner.gradient,
    )
    adam_step(learner.theta, learner.gradient, learner.first, learner.second, step, learning_rate)
    soft_update(learner.target, learner.theta, np.float32(target_update_rate))
    return loss / batch_size


@compiled
def greedy_action(net, theta, state, work, q):
    forward_single(net, theta, state, work, q)
    best = 0
    for a in range(1, q.size):
        if q[a] > q[best]:
            best = a
    return best


@compiled
def test_returns(net, theta, environment, first_episode, episodes):
    """Returns (episodes,) of greedy episodes on the compiled real task, starting
    from the rows `first_episode`, ... of its initial physics (`EvaluateAgent`)."""
    state = np.zeros(environment.state_size, np.float32)
    work = np.zeros((2, net.sizes[1]), np.float32)
    q = np.zeros(net.sizes[net.sizes.size - 1], np.float32)
    returns = np.zeros(episodes)
    for episode in range(episodes):
        row = (first_episode + episode) % environment.initial_physics.shape[0]
        physics = environment.initial_physics[row].copy()
        for _ in range(environment.step_limit):
            dynamics.observe(environment.dynamics, physics, state)
            action = greedy_action(net, theta, state, work, q)
            reward, done = dynamics.step(environment.dynamics, physics, action)
            returns[episode] += reward
            if done:
                break
    return returns


@compiled
def train(learner, environment, test_environment, settings, rng):
    """Train on `environment` until its stopping rule holds or the episodes are
    spent (`TrainAgent`); the parameters are left in `learner.theta`.

    for each episode:                            # at most max_episodes
        for each step:                           # at most step_limit
            act epsilon-greedily, store the transition
            gradient step                        # once init_episodes are over
        stop on an SE: returns have converged
        stop on the real task: greedy test episodes are solved on average

    Returns environment steps, episodes and why it ended (`stopping`).
    """
    net = learner.net
    n_actions = net.sizes[net.sizes.size - 1]
    n_states = environment.state_size
    state = np.zeros(n_states, np.float32)
    next_state = np.zeros(n_states, np.float32)
    physics = np.zeros(environment.initial_physics.shape[1])
    work = np.zeros((2, net.sizes[1]), np.float32)
    se_work = np.zeros((2, environment.se.action_biases.shape[1]), np.float32)
    q = np.zeros(n_actions, np.float32)
    capacity = min(settings.replay_capacity, settings.max_episodes * environment.step_limit)
    memory = np.empty((capacity, 2 * n_states + 3), np.float32)
    returns = np.zeros(settings.max_episodes)
    steps = 0
    gradient_steps = 0
    epsilon = settings.initial_epsilon

    for episode in range(settings.max_episodes):
        physics[:] = environment.initial_physics[episode % environment.initial_physics.shape[0]]
        dynamics.observe(environment.dynamics, physics, state)
        for _ in range(environment.step_limit):
            if uniform(rng) < epsilon:
                action = below(rng, n_actions)
            else:
                action = greedy_action(net, learner.theta, state, work, q)
            if environment.synthetic:
                reward, done = se_step(environment.se, state, action, next_state, se_work)
                terminated = done > 0.5
            else:
                real_reward, terminated = dynamics.step(environment.dynamics, physics, action)
                dynamics.observe(environment.dynamics, physics, next_state)
                reward = np.float32(real_reward)
                done = np.float32(1) if terminated else np.float32(0)
            if not is_finite(reward + done + next_state.sum()):
                return steps, episode, NOT_FINITE
            store(memory, steps, state, action, next_state, reward, done)
            state[:] = next_state
            steps += 1
            returns[episode] += reward
            if episode >= settings.init_episodes:
                sample(
                    memory,
                    steps,
                    rng,
                    learner.states,
                    learner.next_states,
                    learner.rewards,
                    learner.dones,
                    learner.actions,
                )
                gradient_steps += 1
                loss = gradient_step(
                    learner,
                    gradient_steps,
                    settings.learning_rate,
                    settings.discount,
                    settings.target_update_rate,
                )
                if not is_finite(loss):
                    return steps, episode, NOT_FINITE
            if terminated:
                break
        epsilon = max(epsilon * settings.epsilon_decay, settings.minimal_epsilon)
        if environment.synthetic:
            if converged(
                returns,
                episode,
                settings.init_episodes,
                settings.early_out_episodes,
                settings.early_out_difference,
            ):
                return steps, episode + 1, CONVERGED
        elif episode >= settings.init_episodes:
            first = episode * settings.test_episodes
            tests = test_returns(
                net, learner.theta, test_environment, first, settings.test_episodes
            )
            if tests.mean() >= environment.solved_reward:
                return steps, episode + 1, CONVERGED
    return steps, settings.max_episodes, EPISODES_SPENT
