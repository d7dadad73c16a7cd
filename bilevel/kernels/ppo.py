"""PPO, compiled: the twin of the definition `bilevel.agents.ppo`.

symbol     shape             meaning
--------   ---------------   --------------------------------------------------
N, B       -                 steps of a rollout, transitions of a minibatch
columns    -                 N or B, padded to whole vector registers
scale      (A,) float32      logarithm of the standard deviation (continuous actions)
logs       (N,)              log pi of the rollout's actions before the update
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import PPOHyperparameters
from bilevel.kernels.adam import Learned, adam_step, learned
from bilevel.kernels.jit import compiled
from bilevel.kernels.mlp import Work, backward, forward, forward_single, padded, work_space, zeros
from bilevel.kernels.random import below, gumbel, normal
from bilevel.kernels.training import act, end_episode, greedy, implements, learn
from bilevel.networks import Network, orthogonal_parameters

_f = np.float32
_ONE = _f(1)


class Settings(NamedTuple):
    """The fields of `PPOHyperparameters` that the kernels read."""

    epochs: int
    minibatch: int
    learning_rate: float
    discount: float
    advantage_decay: float
    clip: float
    entropy: float
    gradient_norm: float


class Rollout(NamedTuple):
    """The transitions since the last update, one per column, and what the update computes."""

    states: NDArray[np.float32]  # (S, columns)
    next_states: NDArray[np.float32]  # (S, columns)
    actions: NDArray[np.float32]  # (M, columns)
    rewards: NDArray[np.float32]  # (N,)
    dones: NDArray[np.float32]  # (N,) raw outputs
    ends: NDArray[np.bool_]  # (N,) ends of episodes
    values: NDArray[np.float32]  # (1, columns)
    after: NDArray[np.float32]  # (1, columns) values of next states
    outputs: NDArray[np.float32]  # (A, columns) of the policy
    logs: NDArray[np.float32]  # (N,)
    advantages: NDArray[np.float32]  # (N,)
    order: NDArray[np.int64]  # (N,)


class PPOKernel(NamedTuple):
    """An agent: parameters, optimisers, rollout, and work space."""

    settings: Settings
    policy_net: Network
    value_net: Network
    policy: Learned
    scale: Learned
    value: Learned
    counts: NDArray[np.int64]  # (2,) transitions in the rollout, gradient steps
    action: NDArray[np.float32]  # (M,) the last action
    rollout: Rollout
    rollout_work: tuple[Work, Work]  # of policy and value, for N samples
    work: tuple[Work, Work]  # for B samples
    states: NDArray[np.float32]  # (S, columns) of a minibatch
    outputs: NDArray[np.float32]  # (A, columns)
    delta_outputs: NDArray[np.float32]  # (A, columns)
    values: NDArray[np.float32]  # (1, columns)
    delta_values: NDArray[np.float32]  # (1, columns)
    single: NDArray[np.float32]  # (A,) outputs for one state

    def parameters(self) -> list[NDArray[np.float32]]:
        """The parameters of policy and value."""
        return [self.policy.online, self.value.online]


class ContinuousPPOKernel(PPOKernel):
    """An agent with continuous actions; `action` is the last one, not clipped."""

    __slots__ = ()

    def parameters(self) -> list[NDArray[np.float32]]:
        """The parameters of policy and value, and the scale."""
        return [self.policy.online, self.value.online, self.scale.online]


def new_agent(
    hp: PPOHyperparameters,
    state_size: int,
    action_size: int,
    rng: np.random.Generator,
    kind: type[PPOKernel] = PPOKernel,
) -> PPOKernel:
    """A fresh agent; `rng` draws the initial parameters."""
    policy, value = hp.networks(state_size, action_size)
    steps, columns, some = hp.rollout_steps, padded(hp.rollout_steps), padded(hp.minibatch)
    stored = action_size if kind is ContinuousPPOKernel else 1
    return kind(
        settings=Settings(*(getattr(hp, name) for name in Settings._fields)),
        policy_net=policy,
        value_net=value,
        policy=learned(orthogonal_parameters(policy, rng, hp.output_gains[0])),
        scale=learned(zeros(action_size)),
        value=learned(orthogonal_parameters(value, rng, hp.output_gains[1])),
        counts=np.zeros(2, np.int64),
        action=zeros(stored),
        rollout=Rollout(
            states=zeros(state_size, columns),
            next_states=zeros(state_size, columns),
            actions=zeros(stored, columns),
            rewards=zeros(steps),
            dones=zeros(steps),
            ends=np.zeros(steps, np.bool_),
            values=zeros(1, columns),
            after=zeros(1, columns),
            outputs=zeros(action_size, columns),
            logs=zeros(steps),
            advantages=zeros(steps),
            order=np.zeros(steps, np.int64),
        ),
        rollout_work=(work_space(policy, steps), work_space(value, steps)),
        work=(work_space(policy, hp.minibatch), work_space(value, hp.minibatch)),
        states=zeros(state_size, some),
        outputs=zeros(action_size, some),
        delta_outputs=zeros(action_size, some),
        values=zeros(1, some),
        delta_values=zeros(1, some),
        single=zeros(action_size),
    )


def new_continuous_agent(
    hp: PPOHyperparameters, state_size: int, action_size: int, rng: np.random.Generator
) -> PPOKernel:
    """A fresh agent with continuous actions; `rng` draws the initial parameters."""
    return new_agent(hp, state_size, action_size, rng, ContinuousPPOKernel)


def log_probability(agent, outputs, i, j):
    """log pi of the rollout's action `j`, given the policy's outputs in column `i`."""


def add_gradient(agent, i, j, weight, entropy):
    """Write the gradient of the loss into column `i` of `agent.delta_outputs` and add that of the
    scale, given its derivative with respect to log pi of the rollout's action `j`, and the negative
    weight of the entropy."""


@compiled
def append(agent, memory, steps):
    """Copy the last transition in the memory to the rollout."""
    rollout, t = agent.rollout, agent.counts[0]
    row, n = memory[(steps - 1) % memory.shape[0]], rollout.states.shape[0]
    for k in range(n):
        rollout.states[k, t] = row[k]
        rollout.next_states[k, t] = row[n + k]
    rollout.rewards[t], rollout.dones[t], rollout.ends[t] = row[2 * n], row[2 * n + 1], False
    for k in range(rollout.actions.shape[0]):
        rollout.actions[k, t] = row[2 * n + 2 + k]
    agent.counts[0] += 1


@compiled
def learn_from_rollout(agent, memory, steps, rng):
    """Append the last transition, and learn from the rollout once it is complete; return the last
    minibatch's squared error of values, 0 before."""
    append(agent, memory, steps)
    rollout, settings = agent.rollout, agent.settings
    size, minibatch = rollout.rewards.size, settings.minibatch
    loss = _f(0)
    if agent.counts[0] < size:
        return loss
    agent.counts[0] = 0
    estimate_advantages(agent)
    for _ in range(settings.epochs):
        shuffle(rollout.order, rng)
        for batch in range(size // minibatch):
            rows = rollout.order[batch * minibatch : (batch + 1) * minibatch]
            loss = gradient_step(agent, rows)
    return loss


implements(PPOKernel, learn)(learn_from_rollout)
implements(ContinuousPPOKernel, learn)(learn_from_rollout)


@compiled
def estimate_advantages(agent):
    """Compute values, advantages and log pi of the rollout."""
    rollout, (policy_work, value_work) = agent.rollout, agent.rollout_work
    forward(agent.value_net, agent.value.online, rollout.next_states, value_work, rollout.after)
    forward(agent.value_net, agent.value.online, rollout.states, value_work, rollout.values)
    forward(agent.policy_net, agent.policy.online, rollout.states, policy_work, rollout.outputs)
    discount = agent.settings.discount
    decay, following = discount * agent.settings.advantage_decay, 0.0
    for t in range(rollout.rewards.size - 1, -1, -1):
        kept = discount * (1.0 - rollout.dones[t])
        difference = rollout.rewards[t] + kept * rollout.after[0, t] - rollout.values[0, t]
        following = difference + (0.0 if rollout.ends[t] else decay * following)
        rollout.advantages[t] = following
        rollout.logs[t] = log_probability(agent, rollout.outputs, t, t)


@compiled
def shuffle(order, rng):
    """Write a random order of 0, 1, ... into `order` (Fisher and Yates)."""
    for i in range(order.size):
        order[i] = i
    for last in range(order.size - 1, 0, -1):
        other = below(rng, last + 1)
        order[last], order[other] = order[other], order[last]


@compiled
def gradient_step(agent, rows):
    """Make one Adam step of policy and value on these rows (B,) of the rollout; return the squared
    error of values."""
    rollout, settings, size = agent.rollout, agent.settings, rows.size
    for i in range(size):
        for k in range(agent.states.shape[0]):
            agent.states[k, i] = rollout.states[k, rows[i]]
    agent.counts[1] += 1
    policy_step(agent, rows)

    work, values, delta = agent.work[1], agent.values, agent.delta_values
    forward(agent.value_net, agent.value.online, agent.states, work, values)
    loss, share = _f(0), _f(1.0 / size)
    for i in range(size):
        j = rows[i]
        error = values[0, i] - (rollout.advantages[j] + rollout.values[0, j])
        delta[0, i] = share * error
        loss += share * error * error
    backward(agent.value_net, agent.value.online, agent.states, work, delta, agent.value.gradient)
    bound(agent.value.gradient, agent.value.gradient[:0], settings.gradient_norm)
    adam_step(agent.value, agent.counts[1], settings.learning_rate)
    return loss


@compiled
def policy_step(agent, rows):
    """Make one Adam step of the policy, given the minibatch's states."""
    rollout, settings, size = agent.rollout, agent.settings, rows.size
    mean, square = 0.0, 0.0
    for i in range(size):
        mean += rollout.advantages[rows[i]] / size
    for i in range(size):
        square += (rollout.advantages[rows[i]] - mean) ** 2 / size
    spread = math.sqrt(square) + 1e-8

    outputs, work = agent.outputs, agent.work[0]
    forward(agent.policy_net, agent.policy.online, agent.states, work, outputs)
    agent.scale.gradient[:] = 0
    for i in range(size):
        j = rows[i]
        advantage = (rollout.advantages[j] - mean) / spread
        ratio = math.exp(log_probability(agent, outputs, i, j) - rollout.logs[j])
        far = ratio > 1 + settings.clip if advantage > 0 else ratio < 1 - settings.clip
        weight = 0.0 if far else -advantage * ratio / size
        add_gradient(agent, i, j, _f(weight), _f(-settings.entropy / size))
    backward(
        agent.policy_net,
        agent.policy.online,
        agent.states,
        work,
        agent.delta_outputs,
        agent.policy.gradient,
    )
    bound(agent.policy.gradient, agent.scale.gradient, settings.gradient_norm)
    adam_step(agent.policy, agent.counts[1], settings.learning_rate)
    adam_step(agent.scale, agent.counts[1], settings.learning_rate)


@compiled
def bound(gradient, other, largest):
    """Shorten a gradient in two parts to the norm `largest`, as torch does."""
    square = 0.0
    for g in gradient:
        square += g * g
    for g in other:
        square += g * g
    factor = _f(min(largest / (math.sqrt(square) + 1e-6), 1.0))
    for i in range(gradient.size):
        gradient[i] *= factor
    for i in range(other.size):
        other[i] *= factor


@compiled
def log_sum(outputs, i):
    """log sum exp of column `i`."""
    highest = outputs[0, i]
    for a in range(1, outputs.shape[0]):
        highest = max(highest, outputs[a, i])
    total = _f(0)
    for a in range(outputs.shape[0]):
        total += np.exp(outputs[a, i] - highest)
    return highest + np.log(total)


@implements(PPOKernel, log_probability)
@compiled
def softmax_log_probability(agent, outputs, i, j):
    """log softmax of the action."""
    return outputs[np.int64(agent.rollout.actions[0, j]), i] - log_sum(outputs, i)


@implements(ContinuousPPOKernel, log_probability)
@compiled
def normal_log_probability(agent, outputs, i, j):
    """log of the normal density, up to a constant."""
    total, scale = _f(0), agent.scale.online
    for a in range(outputs.shape[0]):
        z = (agent.rollout.actions[a, j] - outputs[a, i]) * np.exp(-scale[a])
        total -= _f(0.5) * z * z + scale[a]
    return total


@implements(PPOKernel, add_gradient)
@compiled
def add_softmax_gradient(agent, i, j, weight, entropy):
    """d log pi / d output_a = [a is the action] - p_a; d entropy = -p_a (log p_a + entropy)."""
    outputs, delta = agent.outputs, agent.delta_outputs
    chosen, total, mean = np.int64(agent.rollout.actions[0, j]), log_sum(outputs, i), _f(0)
    for a in range(outputs.shape[0]):
        log = outputs[a, i] - total
        mean += np.exp(log) * log
    for a in range(outputs.shape[0]):
        log = outputs[a, i] - total
        p = np.exp(log)
        delta[a, i] = -weight * p - entropy * p * (log - mean)
    delta[chosen, i] += weight


@implements(ContinuousPPOKernel, add_gradient)
@compiled
def add_normal_gradient(agent, i, j, weight, entropy):
    """With z = (action - output) / exp(scale): d log pi / d output = z / exp(scale) and
    d log pi / d scale = z^2 - 1; d entropy / d scale = 1."""
    scale = agent.scale
    for a in range(agent.outputs.shape[0]):
        inverse = np.exp(-scale.online[a])
        z = (agent.rollout.actions[a, j] - agent.outputs[a, i]) * inverse
        agent.delta_outputs[a, i] = weight * z * inverse
        scale.gradient[a] += weight * (z * z - _ONE) + entropy


@compiled
def outputs_for(agent, state):
    """The policy's outputs (A,) for one state."""
    forward_single(agent.policy_net, agent.policy.online, state, agent.work[0], agent.single)
    return agent.single


@implements(PPOKernel, greedy)
@compiled
def most_probable_action(agent, state):
    """The action with the highest output."""
    return np.argmax(outputs_for(agent, state))


@implements(ContinuousPPOKernel, greedy)
@compiled
def mean_action(agent, state):
    """The mean (A,), clipped to [-1, 1]."""
    outputs = outputs_for(agent, state)
    for a in range(outputs.size):
        outputs[a] = min(max(outputs[a], -_ONE), _ONE)
    return outputs


@implements(PPOKernel, act)
@compiled
def sample_action(agent, state, exploring, rng):
    """An action from the softmax distribution."""
    outputs = outputs_for(agent, state)
    for a in range(outputs.size):
        outputs[a] += gumbel(rng)
    index = np.argmax(outputs)
    agent.action[0] = index
    return index


@implements(ContinuousPPOKernel, act)
@compiled
def sample_normal_action(agent, state, exploring, rng):
    """An action from the normal distribution (A,), clipped to [-1, 1]."""
    outputs, action = outputs_for(agent, state), agent.action
    for a in range(outputs.size):
        action[a] = outputs[a] + np.exp(agent.scale.online[a]) * normal(rng)
        outputs[a] = min(max(action[a], -_ONE), _ONE)
    return outputs


@compiled
def mark_end(agent):
    """Mark the end of an episode in the rollout."""
    if agent.counts[0]:
        agent.rollout.ends[agent.counts[0] - 1] = True


implements(PPOKernel, end_episode)(mark_end)
implements(ContinuousPPOKernel, end_episode)(mark_end)
