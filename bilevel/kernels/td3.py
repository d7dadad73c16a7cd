"""TD3, compiled: the twin of the definition `bilevel.agents.td3`.

symbol     shape             meaning
--------   ---------------   --------------------------------------------------
actor      (P_a,) float32    parameters of the actor, S -> A
critics    2 x (P_c,)        parameters of the critics, value of (S + A) -> 1
outputs    (A, B')           the actor's outputs before its squashing function
A          -                 length of an action vector
B, B'      -                 batch size; padded to whole vector registers

`bilevel.kernels.td3_discrete` shares the critics' step and has its own kind of actor: it implements
`target_actions` and `actor_step` for its type.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import TD3Hyperparameters
from bilevel.kernels.activations import tanh
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
from bilevel.kernels.random import normal, uniform
from bilevel.kernels.replay import Batch, new_batch, sample
from bilevel.kernels.training import act, end_episode, greedy, implements, learn
from bilevel.networks import Network, initial_parameters

_f = np.float32


class Settings(NamedTuple):
    """The fields of `TD3Hyperparameters` that the kernels read."""

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
    rho: Learned  # logarithm of the temperature, of discrete actions only
    critics: tuple[Learned, Learned]
    steps: NDArray[np.int64]  # (2,) gradient steps of critics and of actor
    action: NDArray[np.float32]  # (A,) the last action
    batch: Batch
    actor_work: Work
    critic_work: Work
    next_inputs: NDArray[np.float32]  # (S + A, B') next states and target actions
    policy_inputs: NDArray[np.float32]  # (S + A, B') states and the actor's actions
    delta_inputs: NDArray[np.float32]  # (S + A, B')
    outputs: NDArray[np.float32]  # (A, B')
    delta_outputs: NDArray[np.float32]  # (A, B')
    value: NDArray[np.float32]  # (1, B')
    delta_value: NDArray[np.float32]  # (1, B')
    goal: NDArray[np.float32]  # (B',)
    single: NDArray[np.float32]  # (A,) outputs for one state

    def parameters(self) -> list[NDArray[np.float32]]:
        """The parameters of actor and critics, then their targets."""
        parts = (self.actor, *self.critics)
        return [part.online for part in parts] + [part.target for part in parts]


def new_agent(
    hp: TD3Hyperparameters,
    state_size: int,
    action_size: int,
    rng: np.random.Generator,
    kind: type[TD3Kernel] = TD3Kernel,
) -> TD3Kernel:
    """A fresh agent; `rng` draws the initial parameters of actor and critics."""
    actor, critic = hp.networks(state_size, action_size)
    columns, inputs = padded(hp.batch_size), state_size + action_size
    return kind(
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
        action=zeros(action_size),
        batch=new_batch(state_size, action_size, hp.batch_size),
        actor_work=work_space(actor, hp.batch_size),
        critic_work=work_space(critic, hp.batch_size),
        next_inputs=zeros(inputs, columns),
        policy_inputs=zeros(inputs, columns),
        delta_inputs=zeros(inputs, columns),
        outputs=zeros(action_size, columns),
        delta_outputs=zeros(action_size, columns),
        value=zeros(1, columns),
        delta_value=zeros(1, columns),
        goal=zeros(columns),
        single=zeros(action_size),
    )


def target_actions(agent, rng, actions):
    """Write the smoothed target actions in `agent.next_inputs` into `actions` (A, B')."""


def actor_step(agent, rng):
    """Make one step of the actor, uphill on the first critic's value."""


@compiled
def smoothing(settings, rng):
    """Noise of target smoothing."""
    limit = _f(settings.target_noise_clip)
    return min(max(_f(settings.target_noise) * normal(rng), -limit), limit)


@compiled
def critic_step(agent, rng):
    """Make one gradient step of both critics; return the loss."""
    settings, batch, net, work = agent.settings, agent.batch, agent.critic_net, agent.critic_work
    n_states, batch_size = batch.states.shape[0], batch.rewards.size
    agent.next_inputs[:n_states] = batch.next_states
    target_actions(agent, rng, agent.next_inputs[n_states:])

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
def action_gradients(agent):
    """Write the gradient of the first critic's loss, minus its mean value, with respect to the
    states and actions in `agent.policy_inputs` into `agent.delta_inputs`."""
    net, work, critic = agent.critic_net, agent.critic_work, agent.critics[0]
    batch_size = agent.batch.rewards.size
    forward(net, critic.online, agent.policy_inputs, work, agent.value)
    for i in range(batch_size):
        agent.delta_value[0, i] = _f(-1.0 / batch_size)
    # This overwrites the critic's own gradient, which its next step computes again.
    propagate(net, critic.online, work, agent.delta_value, critic.gradient)
    product(layer_weights(net, critic.online, 0).T, work.delta_h[0], agent.delta_inputs)


@compiled
def actor_adam_step(agent):
    """Make one Adam step of the actor with the gradient `agent.delta_outputs`."""
    actor, work = agent.actor, agent.actor_work
    backward(
        agent.actor_net, actor.online, agent.batch.states, work, agent.delta_outputs, actor.gradient
    )
    agent.steps[1] += 1
    adam_step(actor, agent.steps[1], agent.settings.learning_rate)


@compiled
def learn_from_sample(agent, memory, steps, rng):
    """Make one step of the critics on a minibatch, and every `policy_delay` steps one of actor and
    targets; return the loss."""
    sample(memory, steps, rng, agent.batch)
    loss = critic_step(agent, rng)
    if agent.steps[0] % agent.settings.policy_delay == 0:
        actor_step(agent, rng)
        rate = _f(agent.settings.target_update_rate)
        soft_update(agent.actor, rate)
        soft_update(agent.rho, rate)
        for c in range(2):
            soft_update(agent.critics[c], rate)
    return loss


implements(TD3Kernel, learn)(learn_from_sample)


@implements(TD3Kernel, target_actions)
@compiled
def smoothed_actions(agent, rng, actions):
    """tanh of the target actor's outputs, plus clipped noise, clipped to [-1, 1]."""
    next_states = agent.next_inputs[: agent.batch.states.shape[0]]
    forward(agent.actor_net, agent.actor.target, next_states, agent.actor_work, agent.outputs)
    for i in range(agent.batch.rewards.size):
        for a in range(actions.shape[0]):
            noisy = tanh(agent.outputs[a, i]) + smoothing(agent.settings, rng)
            actions[a, i] = min(max(noisy, _f(-1)), _f(1))


@implements(TD3Kernel, actor_step)
@compiled
def deterministic_actor_step(agent, rng):
    """The deterministic policy gradient (Silver et al., 2014)."""
    batch, n_states = agent.batch, agent.batch.states.shape[0]
    agent.policy_inputs[:n_states] = batch.states
    actions, deltas = agent.policy_inputs[n_states:], agent.delta_inputs[n_states:]
    forward(agent.actor_net, agent.actor.online, batch.states, agent.actor_work, agent.outputs)
    for a in range(actions.shape[0]):
        for i in range(batch.rewards.size):
            actions[a, i] = tanh(agent.outputs[a, i])
    action_gradients(agent)
    for a in range(actions.shape[0]):
        for i in range(batch.rewards.size):
            agent.delta_outputs[a, i] = deltas[a, i] * (_f(1) - actions[a, i] * actions[a, i])
    actor_adam_step(agent)


@implements(TD3Kernel, greedy)
@compiled
def greedy_action(agent, state):
    """tanh of the actor's outputs (A,)."""
    outputs = agent.single
    forward_single(agent.actor_net, agent.actor.online, state, agent.actor_work, outputs)
    for a in range(outputs.size):
        outputs[a] = tanh(outputs[a])
    return outputs


@implements(TD3Kernel, act)
@compiled
def explore(agent, state, exploring, rng):
    """The next training action (A,), uniform in the initial episodes, else the actor's with noise,
    clipped to [-1, 1]."""
    action = agent.action
    if exploring:
        for a in range(action.size):
            action[a] = _f(2.0 * uniform(rng) - 1.0)
        return action
    best = greedy_action(agent, state)
    for a in range(action.size):
        noisy = best[a] + _f(agent.settings.action_noise) * normal(rng)
        action[a] = min(max(noisy, _f(-1)), _f(1))
    return action


@implements(TD3Kernel, end_episode)
@compiled
def end_training_episode(agent):
    """Do nothing."""
