"""Discrete TD3, compiled: the twin of the definition `bilevel.agents.td3_discrete`.

It is TD3 (`bilevel.kernels.td3`) with A discrete actions. The actor's outputs are logits:

symbol     shape             meaning
--------   ---------------   --------------------------------------------------
rho        (1,) float32      logarithm of the Gumbel-Softmax temperature
soft       (A, B')           relaxed one-hot actions, softmax((logits + g) / exp(rho))
"""

import math

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import TD3Hyperparameters
from bilevel.kernels import td3
from bilevel.kernels.adam import adam_step
from bilevel.kernels.jit import compiled
from bilevel.kernels.mlp import forward, forward_single
from bilevel.kernels.random import below, gumbel, normal
from bilevel.kernels.td3 import TD3Kernel, action_gradients, actor_adam_step, smoothing
from bilevel.kernels.training import act, end_episode, greedy, implements, learn

_f = np.float32


class DiscreteTD3Kernel(TD3Kernel):
    """An agent with discrete actions; `action` is the last one, relaxed and noisy."""

    __slots__ = ()

    def parameters(self) -> list[NDArray[np.float32]]:
        """The parameters of actor, rho and critics, then their targets."""
        parts = (self.actor, self.rho, *self.critics)
        return [part.online for part in parts] + [part.target for part in parts]


def new_agent(
    hp: TD3Hyperparameters, state_size: int, action_size: int, rng: np.random.Generator
) -> TD3Kernel:
    """A fresh agent; `rng` draws the initial parameters of actor and critics."""
    return td3.new_agent(hp, state_size, action_size, rng, DiscreteTD3Kernel)


@compiled
def relax(logits, rho, batch_size, rng, soft):
    """Draw `soft` (A, B') from the Gumbel-Softmax distribution (Jang et al., 2017)
    of `logits` (A, B'), which are left scaled: (logits + g) / exp(rho)."""
    action_size = logits.shape[0]
    inverse = _f(1) / np.exp(rho)
    for i in range(batch_size):
        highest = -_f(np.inf)
        for a in range(action_size):
            logits[a, i] = (logits[a, i] + gumbel(rng)) * inverse
            highest = max(highest, logits[a, i])
        total = _f(0)
        for a in range(action_size):
            soft[a, i] = np.exp(logits[a, i] - highest)
            total += soft[a, i]
        for a in range(action_size):
            soft[a, i] /= total


@implements(DiscreteTD3Kernel, td3.target_actions)
@compiled
def relaxed_actions(agent, rng, actions):
    """Relaxed actions of the target actor, plus clipped noise."""
    next_states = agent.next_inputs[: agent.batch.states.shape[0]]
    batch_size = agent.batch.rewards.size
    forward(agent.actor_net, agent.actor.target, next_states, agent.actor_work, agent.outputs)
    relax(agent.outputs, agent.rho.target[0], batch_size, rng, actions)
    for i in range(batch_size):
        for a in range(actions.shape[0]):
            actions[a, i] += smoothing(agent.settings, rng)


@implements(DiscreteTD3Kernel, td3.actor_step)
@compiled
def relaxed_actor_step(agent, rng):
    """Make one step of actor and temperature, uphill on the first critic's value."""
    settings, batch, rho = agent.settings, agent.batch, agent.rho
    n_states, batch_size = batch.states.shape[0], batch.rewards.size
    agent.policy_inputs[:n_states] = batch.states
    soft, deltas = agent.policy_inputs[n_states:], agent.delta_inputs[n_states:]
    forward(agent.actor_net, agent.actor.online, batch.states, agent.actor_work, agent.outputs)
    relax(agent.outputs, rho.online[0], batch_size, rng, soft)
    action_gradients(agent)

    inverse = _f(1) / np.exp(rho.online[0])
    delta_rho = _f(0)
    for i in range(batch_size):
        mean = _f(0)
        for a in range(soft.shape[0]):
            mean += soft[a, i] * deltas[a, i]
        for a in range(soft.shape[0]):
            delta = soft[a, i] * (deltas[a, i] - mean)
            delta_rho -= delta * agent.outputs[a, i]
            agent.delta_outputs[a, i] = delta * inverse
    actor_adam_step(agent)
    rho.gradient[0] = delta_rho
    adam_step(rho, agent.steps[1], settings.learning_rate)
    lowest, highest = settings.temperatures
    rho.online[0] = min(max(rho.online[0], _f(math.log(lowest))), _f(math.log(highest)))


implements(DiscreteTD3Kernel, learn)(td3.learn_from_sample)


@implements(DiscreteTD3Kernel, greedy)
@compiled
def greedy_action(agent, state):
    """The action with the highest logit: the most probable one."""
    logits = agent.single
    forward_single(agent.actor_net, agent.actor.online, state, agent.actor_work, logits)
    return np.argmax(logits)


@implements(DiscreteTD3Kernel, act)
@compiled
def explore(agent, state, exploring, rng):
    """The next training action, uniform in the initial episodes; its vector is `agent.action`."""
    action, logits = agent.action, agent.single
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


implements(DiscreteTD3Kernel, end_episode)(td3.end_training_episode)
