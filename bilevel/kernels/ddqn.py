"""Double DQN and Dueling Double DQN, compiled: the twin of the definition `bilevel.agents.ddqn`.

Both draw the same random numbers in the same order, so whole training runs can be compared.

symbol   shape            meaning
------   --------------   -----------------------------------------
theta    (P,) float32     parameters of the Q-network
target   (P,) float32     parameters of the target network
y        (O, B')          outputs: action values (O = A), or value and
                          advantages (O = 1 + A) of a dueling network
q        (A, B')          action values
A, B'    -                number of actions; batch size, padded
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.kernels.adam import adam_step, soft_update
from bilevel.kernels.jit import compiled
from bilevel.kernels.mlp import backward, forward, forward_single, padded
from bilevel.kernels.random import below, uniform
from bilevel.kernels.replay import Batch, new_batch
from bilevel.kernels.training import act, end_episode, greedy, implements, learn
from bilevel.networks import Network, initial_parameters


class Settings(NamedTuple):
    """Hyperparameters in the form of the kernel (see `DDQNHyperparameters`)."""

    learning_rate: float
    target_update_rate: float
    discount: float
    minimal_epsilon: float
    epsilon_decay: float
    dueling: bool


class DDQNKernel(NamedTuple):
    """An agent: parameters, optimiser, exploration, and work space."""

    settings: Settings
    net: Network
    theta: NDArray[np.float32]
    target: NDArray[np.float32]
    gradient: NDArray[np.float32]
    first: NDArray[np.float32]  # Adam's moments
    second: NDArray[np.float32]
    gradient_steps: NDArray[np.int64]  # (1,)
    epsilon: NDArray[np.float64]  # (1,)
    action: NDArray[np.float32]  # (1,) index of the last action
    batch: Batch
    h: NDArray[np.float32]  # (depth, H, B') of the states
    z: NDArray[np.float32]
    h_next: NDArray[np.float32]  # (depth, H, B') of the next states
    z_next: NDArray[np.float32]
    delta_h: NDArray[np.float32]
    y: NDArray[np.float32]  # (O, B')
    delta_y: NDArray[np.float32]
    q: NDArray[np.float32]  # (A, B')
    q_next: NDArray[np.float32]
    q_target: NDArray[np.float32]
    delta_q: NDArray[np.float32]
    single_h: NDArray[np.float32]  # (2, H) for a single state
    single_y: NDArray[np.float32]  # (O,)


def new_agent(
    hp: DDQNHyperparameters, state_size: int, n_actions: int, rng: np.random.Generator
) -> DDQNKernel:
    """A fresh agent; `rng` draws its initial parameters."""
    net = hp.network(state_size, n_actions)
    theta = initial_parameters(net, rng)
    columns, outputs = padded(hp.batch_size), int(net.sizes[-1])
    depth = net.sizes.size - 2

    def zeros(*shape: int) -> NDArray[np.float32]:
        return np.zeros(shape, np.float32)

    def hidden() -> NDArray[np.float32]:
        return zeros(depth, hp.hidden_size, columns)

    return DDQNKernel(
        settings=Settings(
            hp.learning_rate,
            hp.target_update_rate,
            hp.discount,
            hp.minimal_epsilon,
            hp.epsilon_decay,
            hp.dueling,
        ),
        net=net,
        theta=theta,
        target=theta.copy(),
        gradient=np.zeros_like(theta),
        first=np.zeros_like(theta),
        second=np.zeros_like(theta),
        gradient_steps=np.zeros(1, np.int64),
        epsilon=np.array([hp.initial_epsilon]),
        action=zeros(1),
        batch=new_batch(state_size, 1, hp.batch_size),
        h=hidden(),
        z=hidden(),
        h_next=hidden(),
        z_next=hidden(),
        delta_h=hidden(),
        y=zeros(outputs, columns),
        delta_y=zeros(outputs, columns),
        q=zeros(n_actions, columns),
        q_next=zeros(n_actions, columns),
        q_target=zeros(n_actions, columns),
        delta_q=zeros(n_actions, columns),
        single_h=zeros(2, hp.hidden_size),
        single_y=zeros(outputs),
    )


def parameters(agent: DDQNKernel) -> list[NDArray[np.float32]]:
    """The parameters of the online and the target network."""
    return [agent.theta, agent.target]


@compiled
def action_values(agent, params, states, h, z, q):
    """Write the action values of a batch of states into `q` (A, B').

    A dueling network's are the value plus each advantage minus their mean (Wang et al., 2016).
    """
    if not agent.settings.dueling:
        forward(agent.net, params, states, h, z, q)
        return
    y = agent.y
    forward(agent.net, params, states, h, z, y)
    n_actions, columns = q.shape
    share = np.float32(1.0 / n_actions)
    for i in range(columns):
        mean = np.float32(0)
        for a in range(n_actions):
            mean += share * y[1 + a, i]
        for a in range(n_actions):
            q[a, i] = y[0, i] + y[1 + a, i] - mean


@compiled
def output_gradient(agent):
    """The gradient of the network's outputs, given the gradient of the action values."""
    if not agent.settings.dueling:
        return agent.delta_q
    delta_q, delta_y = agent.delta_q, agent.delta_y
    n_actions, columns = delta_q.shape
    share = np.float32(1.0 / n_actions)
    for i in range(columns):
        total = np.float32(0)
        for a in range(n_actions):
            total += delta_q[a, i]
        delta_y[0, i] = total
        for a in range(n_actions):
            delta_y[1 + a, i] = delta_q[a, i] - share * total
    return delta_y


@implements(DDQNKernel, learn)
@compiled
def gradient_step(agent, rng):
    """One gradient step on the minibatch in `agent`; return the mean squared error.

    The online network chooses the next action, the target network values it
    (van Hasselt et al., 2016); the raw done output weighs the future.
    """
    settings, batch = agent.settings, agent.batch
    q, q_next, q_target, delta_q = agent.q, agent.q_next, agent.q_target, agent.delta_q
    action_values(agent, agent.theta, batch.next_states, agent.h_next, agent.z_next, q_next)
    action_values(agent, agent.target, batch.next_states, agent.h_next, agent.z_next, q_target)
    action_values(agent, agent.theta, batch.states, agent.h, agent.z, q)
    n_actions, batch_size = q.shape[0], batch.rewards.size
    gamma, one = np.float32(settings.discount), np.float32(1)
    scale = np.float32(2.0 / batch_size)
    loss = np.float32(0)
    for i in range(batch_size):
        best = 0
        for a in range(1, n_actions):
            if q_next[a, i] > q_next[best, i]:
                best = a
            delta_q[a, i] = 0
        delta_q[0, i] = 0
        goal = batch.rewards[i] + gamma * q_target[best, i] * (one - batch.dones[i])
        action = np.int64(batch.actions[0, i])
        error = q[action, i] - goal
        delta_q[action, i] = scale * error
        loss += error * error
    backward(
        agent.net,
        agent.theta,
        batch.states,
        agent.h,
        agent.z,
        output_gradient(agent),
        agent.delta_h,
        agent.gradient,
    )
    agent.gradient_steps[0] += 1
    adam_step(
        agent.theta,
        agent.gradient,
        agent.first,
        agent.second,
        agent.gradient_steps[0],
        settings.learning_rate,
    )
    soft_update(agent.target, agent.theta, np.float32(settings.target_update_rate))
    return loss / batch_size


@implements(DDQNKernel, greedy)
@compiled
def greedy_action(agent, state):
    """The action with the highest value. (The advantages of a dueling network have the same
    order.)"""
    q = agent.single_y[1:] if agent.settings.dueling else agent.single_y
    forward_single(agent.net, agent.theta, state, agent.single_h, agent.single_y)
    best = 0
    for a in range(1, q.size):
        if q[a] > q[best]:
            best = a
    return best


@implements(DDQNKernel, act)
@compiled
def explore(agent, state, exploring, rng):
    """The next training action, chosen epsilon-greedily."""
    if uniform(rng) < agent.epsilon[0]:
        action = below(rng, agent.q.shape[0])
    else:
        action = greedy_action(agent, state)
    agent.action[0] = action
    return action


@implements(DDQNKernel, end_episode)
@compiled
def decay_epsilon(agent):
    """Decay epsilon."""
    settings = agent.settings
    agent.epsilon[0] = max(agent.epsilon[0] * settings.epsilon_decay, settings.minimal_epsilon)
