"""Discrete TD3, compiled: the twin of the definition `bilevel.agents.td3`.

symbol     shape             meaning
--------   ---------------   --------------------------------------------------
actor      (P_a,) float32    parameters of the actor, logits of S -> A
rho        (1,) float32      logarithm of the Gumbel-Softmax temperature
critics    2 x (P_c,)        parameters of the critics, value of (S + A) -> 1
soft       (A, B')           relaxed one-hot actions, softmax((logits + g) / exp(rho))
B, B'      -                 batch size; padded to whole vector registers
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import TD3Hyperparameters
from bilevel.kernels.adam import Learned, adam_step, learned, soft_update
from bilevel.kernels.jit import compiled
from bilevel.kernels.mlp import (
    Work,
    backward,
    forward,
    forward_single,
    layer_weights,
    padded,
    propagate,
    work_space,
    zeros,
)
from bilevel.kernels.products import product
from bilevel.kernels.random import below, gumbel, normal
from bilevel.kernels.replay import Batch, new_batch
from bilevel.kernels.training import act, end_episode, greedy, implements, learn
from bilevel.networks import Network, initial_parameters

_f = np.float32


class Settings(NamedTuple):
    """The fields of `TD3Hyperparameters` that the kernel reads."""

    learning_rate: float
    target_update_rate: float
    discount: float
    policy_delay: int
    action_noise: float
    target_noise: float
    target_noise_clip: float
    temperatures: tuple[float, float]


class TD3Kernel(NamedTuple):
    """An agent: parameters, optimisers, and work space."""

    settings: Settings
    actor_net: Network
    critic_net: Network
    actor: Learned
    rho: Learned
    critics: tuple[Learned, Learned]
    steps: NDArray[np.int64]  # (2,) gradient steps of critics and of actor
    action: NDArray[np.float32]  # (A,) the last action, relaxed and noisy
    batch: Batch
    actor_work: Work
    critic_work: Work
    next_inputs: NDArray[np.float32]  # (S + A, B') next states and target actions
    policy_inputs: NDArray[np.float32]  # (S + A, B') states and the actor's actions
    delta_inputs: NDArray[np.float32]  # (S + A, B')
    logits: NDArray[np.float32]  # (A, B'), scaled: (logits + g) / temperature
    delta_logits: NDArray[np.float32]  # (A, B')
    value: NDArray[np.float32]  # (1, B')
    delta_value: NDArray[np.float32]  # (1, B')
    goal: NDArray[np.float32]  # (B',)
    single_logits: NDArray[np.float32]  # (A,)

    def parameters(self) -> list[NDArray[np.float32]]:
        """The parameters of actor, rho and critics, then their targets."""
        parts = (self.actor, self.rho, *self.critics)
        return [part.online for part in parts] + [part.target for part in parts]


def new_agent(
    hp: TD3Hyperparameters, state_size: int, n_actions: int, rng: np.random.Generator
) -> TD3Kernel:
    """A fresh agent; `rng` draws the initial parameters of actor and critics."""
    actor, critic = hp.networks(state_size, n_actions)
    columns, inputs = padded(hp.batch_size), state_size + n_actions
    return TD3Kernel(
        settings=Settings(*(getattr(hp, name) for name in Settings._fields)),
        actor_net=actor,
        critic_net=critic,
        actor=learned(initial_parameters(actor, rng)),
        rho=learned(np.array([math.log(hp.initial_temperature)], np.float32)),
        critics=(
            learned(initial_parameters(critic, rng)),
            learned(initial_parameters(critic, rng)),
        ),
        steps=np.zeros(2, np.int64),
        action=zeros(n_actions),
        batch=new_batch(state_size, n_actions, hp.batch_size),
        actor_work=work_space(actor, hp.batch_size),
        critic_work=work_space(critic, hp.batch_size),
        next_inputs=zeros(inputs, columns),
        policy_inputs=zeros(inputs, columns),
        delta_inputs=zeros(inputs, columns),
        logits=zeros(n_actions, columns),
        delta_logits=zeros(n_actions, columns),
        value=zeros(1, columns),
        delta_value=zeros(1, columns),
        goal=zeros(columns),
        single_logits=zeros(n_actions),
    )


@compiled
def relax(logits, rho, batch_size, rng, soft):
    """Draw `soft` (A, B') from the Gumbel-Softmax distribution (Jang et al., 2017)
    of `logits` (A, B'), which are left scaled: (logits + g) / exp(rho)."""
    n_actions = logits.shape[0]
    inverse = _f(1) / np.exp(rho)
    for i in range(batch_size):
        highest = -_f(np.inf)
        for a in range(n_actions):
            logits[a, i] = (logits[a, i] + gumbel(rng)) * inverse
            highest = max(highest, logits[a, i])
        total = _f(0)
        for a in range(n_actions):
            soft[a, i] = np.exp(logits[a, i] - highest)
            total += soft[a, i]
        for a in range(n_actions):
            soft[a, i] /= total


@compiled
def critic_step(agent, rng):
    """Make one gradient step of both critics; return the loss."""
    settings, batch, net, work = agent.settings, agent.batch, agent.critic_net, agent.critic_work
    n_states, batch_size = batch.states.shape[0], batch.rewards.size
    next_states, next_actions = agent.next_inputs[:n_states], agent.next_inputs[n_states:]
    next_states[:] = batch.next_states
    forward(agent.actor_net, agent.actor.target, next_states, agent.actor_work, agent.logits)
    relax(agent.logits, agent.rho.target[0], batch_size, rng, next_actions)
    spread, limit = _f(settings.target_noise), _f(settings.target_noise_clip)
    for i in range(batch_size):
        for a in range(agent.logits.shape[0]):
            next_actions[a, i] += min(max(spread * normal(rng), -limit), limit)

    value, delta_value, goal = agent.value, agent.delta_value, agent.goal
    gamma, one = _f(settings.discount), _f(1)
    for c in range(2):
        forward(net, agent.critics[c].target, agent.next_inputs, work, value)
        for i in range(batch_size):
            goal[i] = min(goal[i], value[0, i]) if c == 1 else value[0, i]
    for i in range(batch_size):
        goal[i] = batch.rewards[i] + gamma * (one - batch.dones[i]) * goal[i]

    agent.steps[0] += 1
    scale = _f(2.0 / batch_size)
    loss = _f(0)
    for c in range(2):
        critic = agent.critics[c]
        forward(net, critic.online, batch.inputs, work, value)
        for i in range(batch_size):
            error = value[0, i] - goal[i]
            delta_value[0, i] = scale * error
            loss += error * error
        backward(net, critic.online, batch.inputs, work, delta_value, critic.gradient)
        adam_step(critic, agent.steps[0], settings.learning_rate)
    return loss / batch_size


@compiled
def actor_step(agent, rng):
    """Make one step of actor and temperature, uphill on the first critic's value."""
    settings, batch, actor, rho = agent.settings, agent.batch, agent.actor, agent.rho
    n_states, batch_size = batch.states.shape[0], batch.rewards.size
    n_actions = agent.logits.shape[0]
    agent.policy_inputs[:n_states] = batch.states
    soft = agent.policy_inputs[n_states:]
    forward(agent.actor_net, actor.online, batch.states, agent.actor_work, agent.logits)
    relax(agent.logits, rho.online[0], batch_size, rng, soft)

    net, work, critic = agent.critic_net, agent.critic_work, agent.critics[0]
    forward(net, critic.online, agent.policy_inputs, work, agent.value)
    for i in range(batch_size):
        agent.delta_value[0, i] = _f(-1.0 / batch_size)
    # This overwrites the critic's own gradient, which its next step computes again.
    propagate(net, critic.online, work, agent.delta_value, critic.gradient)
    product(layer_weights(net, critic.online, 0).T, work.delta_h[0], agent.delta_inputs)

    inverse = _f(1) / np.exp(rho.online[0])
    delta_rho, delta_logits = _f(0), agent.delta_logits
    for i in range(batch_size):
        mean = _f(0)
        for a in range(n_actions):
            mean += soft[a, i] * agent.delta_inputs[n_states + a, i]
        for a in range(n_actions):
            delta = soft[a, i] * (agent.delta_inputs[n_states + a, i] - mean)
            delta_rho -= delta * agent.logits[a, i]
            delta_logits[a, i] = delta * inverse
    work = agent.actor_work
    backward(agent.actor_net, actor.online, batch.states, work, delta_logits, actor.gradient)
    agent.steps[1] += 1
    adam_step(actor, agent.steps[1], settings.learning_rate)
    rho.gradient[0] = delta_rho
    adam_step(rho, agent.steps[1], settings.learning_rate)
    lowest, highest = settings.temperatures
    rho.online[0] = min(max(rho.online[0], _f(math.log(lowest))), _f(math.log(highest)))


@implements(TD3Kernel, learn)
@compiled
def gradient_step(agent, rng):
    """Make one step of the critics, and every `policy_delay` steps of actor and targets."""
    loss = critic_step(agent, rng)
    if agent.steps[0] % agent.settings.policy_delay == 0:
        actor_step(agent, rng)
        rate = _f(agent.settings.target_update_rate)
        soft_update(agent.actor, rate)
        soft_update(agent.rho, rate)
        for c in range(2):
            soft_update(agent.critics[c], rate)
    return loss


@implements(TD3Kernel, greedy)
@compiled
def greedy_action(agent, state):
    """The action with the highest logit: the most probable one."""
    logits = agent.single_logits
    forward_single(agent.actor_net, agent.actor.online, state, agent.actor_work, logits)
    return np.argmax(logits)


@implements(TD3Kernel, act)
@compiled
def explore(agent, state, exploring, rng):
    """The next training action, uniform in the initial episodes; its vector is `agent.action`."""
    action, logits = agent.action, agent.single_logits
    if exploring:
        index = below(rng, action.size)
        action[:] = 0
        action[index] = 1
        return index
    forward_single(agent.actor_net, agent.actor.online, state, agent.actor_work, logits)
    column = (action.size, 1)
    relax(logits.reshape(column), agent.rho.online[0], 1, rng, action.reshape(column))
    for a in range(action.size):
        action[a] += _f(agent.settings.action_noise) * normal(rng)
    return np.argmax(action)


@implements(TD3Kernel, end_episode)
@compiled
def rest(agent):
    """Do nothing."""
