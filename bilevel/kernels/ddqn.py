"""Double DQN and Dueling Double DQN, compiled: the twin of the definition `bilevel.agents.ddqn`.

symbol   shape            meaning
------   --------------   -----------------------------------------
theta    (P,) float32     parameters of the Q-network, with targets
y        (O, B')          outputs: action values (O = A), or value and
                          advantages (O = 1 + A) of a dueling network
q        (A, B')          action values
A, B'    -                number of actions; batch size, padded
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.kernels.adam import Learned, adam_step, learned, soft_update
from bilevel.kernels.jit import compiled
from bilevel.kernels.mlp import Work, backward, forward, forward_single, work_space, zeros
from bilevel.kernels.random import below, uniform
from bilevel.kernels.replay import Batch, new_batch, sample
from bilevel.kernels.training import act, end_episode, greedy, implements, learn
from bilevel.networks import Network, initial_parameters


class Settings(NamedTuple):
    """The fields of `DDQNHyperparameters` that the kernel reads."""

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
    theta: Learned
    steps: NDArray[np.int64]  # (1,) gradient steps
    epsilon: NDArray[np.float64]  # (1,)
    action: NDArray[np.float32]  # (1,) index of the last action
    batch: Batch
    work: Work
    action_size: int

    def parameters(self) -> list[NDArray[np.float32]]:
        """The parameters of the online and the target network."""
        return [self.theta.online, self.theta.target]


def new_agent(
    hp: DDQNHyperparameters, state_size: int, action_size: int, rng: np.random.Generator
) -> DDQNKernel:
    """A fresh agent; `rng` draws its initial parameters."""
    net = hp.network(state_size, action_size)
    return DDQNKernel(
        settings=Settings(*(getattr(hp, name) for name in Settings._fields)),
        net=net,
        theta=learned(initial_parameters(net, rng)),
        steps=np.zeros(1, np.int64),
        epsilon=np.array([hp.initial_epsilon]),
        action=zeros(1),
        batch=new_batch(state_size, 1, hp.batch_size),
        work=work_space(net, hp.batch_size),
        action_size=action_size,
    )


@compiled
def action_values(agent, params, states):
    """The action values (A, B') of a batch of states (S, B')."""
    action_size, columns = agent.action_size, states.shape[1]
    y = np.empty((agent.net.sizes[-1], columns), np.float32)
    forward(agent.net, params, states, agent.work, y)
    if not agent.settings.dueling:
        return y
    q = np.empty((action_size, columns), np.float32)
    share = np.float32(1.0 / action_size)
    for i in range(columns):
        mean = np.float32(0)
        for a in range(action_size):
            mean += share * y[1 + a, i]
        for a in range(action_size):
            q[a, i] = y[0, i] + y[1 + a, i] - mean
    return q


@compiled
def output_gradient(agent, delta_q):
    """The gradient (O, B') of the outputs, given that of the action values (A, B')."""
    if not agent.settings.dueling:
        return delta_q
    action_size, columns = delta_q.shape
    delta_y = np.empty((1 + action_size, columns), np.float32)
    share = np.float32(1.0 / action_size)
    for i in range(columns):
        total = np.float32(0)
        for a in range(action_size):
            total += delta_q[a, i]
        delta_y[0, i] = total
        for a in range(action_size):
            delta_y[1 + a, i] = delta_q[a, i] - share * total
    return delta_y


@compiled
def gradient_step(agent):
    """Make one gradient step on the minibatch in `agent`; return the mean squared error."""
    settings, batch, theta = agent.settings, agent.batch, agent.theta
    q_next = action_values(agent, theta.online, batch.next_states)
    q_target = action_values(agent, theta.target, batch.next_states)
    q = action_values(agent, theta.online, batch.states)  # last: `backward` reads its layers
    delta_q = np.zeros_like(q)
    action_size, batch_size = q.shape[0], batch.rewards.size
    gamma, one = np.float32(settings.discount), np.float32(1)
    scale = np.float32(2.0 / batch_size)
    loss = np.float32(0)
    for i in range(batch_size):
        best = 0
        for a in range(1, action_size):
            if q_next[a, i] > q_next[best, i]:
                best = a
        goal = batch.rewards[i] + gamma * q_target[best, i] * (one - batch.dones[i])
        action = np.int64(batch.actions[0, i])
        error = q[action, i] - goal
        delta_q[action, i] = scale * error
        loss += error * error
    delta_y = output_gradient(agent, delta_q)
    backward(agent.net, theta.online, batch.states, agent.work, delta_y, theta.gradient)
    agent.steps[0] += 1
    adam_step(theta, agent.steps[0], settings.learning_rate)
    soft_update(theta, np.float32(settings.target_update_rate))
    return loss / batch_size


@implements(DDQNKernel, learn)
@compiled
def learn_from_sample(agent, memory, steps, rng):
    """Make one gradient step on a minibatch; return the mean squared error."""
    sample(memory, steps, rng, agent.batch)
    return gradient_step(agent)


@implements(DDQNKernel, greedy)
@compiled
def greedy_action(agent, state):
    """The action with the highest value, or advantage: both have the same order."""
    y = np.empty(agent.net.sizes[-1], np.float32)
    forward_single(agent.net, agent.theta.online, state, agent.work, y)
    return np.argmax(y[1:] if agent.settings.dueling else y)


@implements(DDQNKernel, act)
@compiled
def explore(agent, state, exploring, rng):
    """The next training action, chosen epsilon-greedily."""
    if uniform(rng) < agent.epsilon[0]:
        action = below(rng, agent.action_size)
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
