"""Discrete TD3, compiled: the twin of the definition `bilevel.agents.td3`.

symbol     shape             meaning
--------   ---------------   --------------------------------------------------
phi        (P_a,) float32    parameters of the actor, logits of S -> A
rho        (1,) float32      logarithm of the Gumbel-Softmax temperature
theta      2 x (P_c,)        parameters of the critics, value of (S + A) -> 1
soft       (A, B')           relaxed one-hot actions, softmax((logits + g) / exp(rho))
B, B'      -                 batch size; padded to whole vector registers
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import TD3Hyperparameters
from bilevel.kernels.adam import adam_step, soft_update
from bilevel.kernels.jit import compiled
from bilevel.kernels.mlp import (
    backward,
    forward,
    forward_single,
    layer_weights,
    padded,
    propagate,
)
from bilevel.kernels.products import product
from bilevel.kernels.random import below, gumbel, normal
from bilevel.kernels.replay import Batch, new_batch
from bilevel.kernels.training import act, end_episode, greedy, implements, learn
from bilevel.networks import Network, initial_parameters

_f = np.float32


class Settings(NamedTuple):
    """Hyperparameters in the form of the kernel (see `TD3Hyperparameters`)."""

    learning_rate: float
    target_update_rate: float
    discount: float
    policy_delay: int
    action_noise: float
    target_noise: float
    target_noise_clip: float
    lowest_rho: float  # logarithms of the temperatures' ends
    highest_rho: float


class Learned(NamedTuple):
    """A parameter vector with its target, gradient and Adam moments."""

    online: NDArray[np.float32]
    target: NDArray[np.float32]
    gradient: NDArray[np.float32]
    first: NDArray[np.float32]
    second: NDArray[np.float32]


class Layers(NamedTuple):
    """Work space of a network, (depth, H, B') each."""

    h: NDArray[np.float32]
    z: NDArray[np.float32]
    delta_h: NDArray[np.float32]


class TD3Kernel(NamedTuple):
    """An agent: parameters, optimisers, and work space."""

    settings: Settings
    actor: Network
    critic: Network
    phi: Learned
    rho: Learned
    theta: tuple[Learned, Learned]
    steps: NDArray[np.int64]  # (2,) gradient steps of critics and of actor
    action: NDArray[np.float32]  # (A,) the last action, relaxed and noisy
    batch: Batch
    of_actor: Layers
    of_critic: Layers
    next_inputs: NDArray[np.float32]  # (S + A, B') next states and target actions
    policy_inputs: NDArray[np.float32]  # (S + A, B') states and the actor's actions
    delta_inputs: NDArray[np.float32]  # (S + A, B')
    logits: NDArray[np.float32]  # (A, B'), scaled: (logits + g) / temperature
    delta_logits: NDArray[np.float32]  # (A, B')
    value: NDArray[np.float32]  # (1, B')
    delta_value: NDArray[np.float32]  # (1, B')
    goal: NDArray[np.float32]  # (B',)
    single_h: NDArray[np.float32]  # (2, H) for a single state
    single_logits: NDArray[np.float32]  # (A,)


def new_agent(
    hp: TD3Hyperparameters, state_size: int, n_actions: int, rng: np.random.Generator
) -> TD3Kernel:
    """A fresh agent; `rng` draws the initial parameters of actor and critics."""
    actor, critic = hp.networks(state_size, n_actions)
    columns = padded(hp.batch_size)

    def zeros(*shape: int) -> NDArray[np.float32]:
        return np.zeros(shape, np.float32)

    def learned(params: NDArray[np.float32]) -> Learned:
        return Learned(params, params.copy(), *(np.zeros_like(params) for _ in range(3)))

    def layers() -> Layers:
        return Layers(*(zeros(hp.hidden_layers, hp.hidden_size, columns) for _ in range(3)))

    return TD3Kernel(
        settings=Settings(
            hp.learning_rate,
            hp.target_update_rate,
            hp.discount,
            hp.policy_delay,
            hp.action_noise,
            hp.target_noise,
            hp.target_noise_clip,
            *map(math.log, hp.temperatures),
        ),
        actor=actor,
        critic=critic,
        phi=learned(initial_parameters(actor, rng)),
        rho=learned(np.array([math.log(hp.initial_temperature)], np.float32)),
        theta=(
            learned(initial_parameters(critic, rng)),
            learned(initial_parameters(critic, rng)),
        ),
        steps=np.zeros(2, np.int64),
        action=zeros(n_actions),
        batch=new_batch(state_size, n_actions, hp.batch_size),
        of_actor=layers(),
        of_critic=layers(),
        next_inputs=zeros(state_size + n_actions, columns),
        policy_inputs=zeros(state_size + n_actions, columns),
        delta_inputs=zeros(state_size + n_actions, columns),
        logits=zeros(n_actions, columns),
        delta_logits=zeros(n_actions, columns),
        value=zeros(1, columns),
        delta_value=zeros(1, columns),
        goal=zeros(columns),
        single_h=zeros(2, hp.hidden_size),
        single_logits=zeros(n_actions),
    )


def parameters(agent: TD3Kernel) -> list[NDArray[np.float32]]:
    """The parameters of actor, rho and critics, then those of their targets."""
    learned = (agent.phi, agent.rho, *agent.theta)
    return [part.online for part in learned] + [part.target for part in learned]


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
    """Make one gradient step of both critics; return the loss.

    Their goal uses the minimum of both target critics at the target actor's action, which is
    smoothed by clipped noise.
    """
    settings, batch = agent.settings, agent.batch
    n_states, batch_size = batch.states.shape[0], batch.rewards.size
    n_actions = agent.logits.shape[0]
    next_states, next_actions = agent.next_inputs[:n_states], agent.next_inputs[n_states:]
    next_states[:] = batch.next_states
    layers = agent.of_actor
    forward(agent.actor, agent.phi.target, next_states, layers.h, layers.z, agent.logits)
    relax(agent.logits, agent.rho.target[0], batch_size, rng, next_actions)
    spread, limit = _f(settings.target_noise), _f(settings.target_noise_clip)
    for i in range(batch_size):
        for a in range(n_actions):
            next_actions[a, i] += min(max(spread * normal(rng), -limit), limit)

    value, delta_value, goal = agent.value, agent.delta_value, agent.goal
    layers = agent.of_critic
    gamma, one = _f(settings.discount), _f(1)
    for c in range(2):
        params = agent.theta[c].target
        forward(agent.critic, params, agent.next_inputs, layers.h, layers.z, value)
        for i in range(batch_size):
            goal[i] = min(goal[i], value[0, i]) if c == 1 else value[0, i]
    for i in range(batch_size):
        goal[i] = batch.rewards[i] + gamma * (one - batch.dones[i]) * goal[i]

    agent.steps[0] += 1
    scale = _f(2.0 / batch_size)
    loss = _f(0)
    for c in range(2):
        learned = agent.theta[c]
        forward(agent.critic, learned.online, batch.inputs, layers.h, layers.z, value)
        for i in range(batch_size):
            error = value[0, i] - goal[i]
            delta_value[0, i] = scale * error
            loss += error * error
        backward(
            agent.critic,
            learned.online,
            batch.inputs,
            layers.h,
            layers.z,
            delta_value,
            layers.delta_h,
            learned.gradient,
        )
        _descend(learned, agent.steps[0], settings.learning_rate)
    return loss / batch_size


@compiled
def actor_step(agent, rng):
    """Make one gradient ascent step of actor and temperature on the first critic's value of the
    actor's actions."""
    settings, batch = agent.settings, agent.batch
    n_states, batch_size = batch.states.shape[0], batch.rewards.size
    n_actions = agent.logits.shape[0]
    agent.policy_inputs[:n_states] = batch.states
    soft = agent.policy_inputs[n_states:]
    actor, critic = agent.of_actor, agent.of_critic
    forward(agent.actor, agent.phi.online, batch.states, actor.h, actor.z, agent.logits)
    relax(agent.logits, agent.rho.online[0], batch_size, rng, soft)

    judge = agent.theta[0]
    forward(agent.critic, judge.online, agent.policy_inputs, critic.h, critic.z, agent.value)
    for i in range(batch_size):
        agent.delta_value[0, i] = _f(-1.0 / batch_size)
    # This overwrites the critic's own gradient, which its next step computes again.
    propagate(
        agent.critic,
        judge.online,
        critic.h,
        critic.z,
        agent.delta_value,
        critic.delta_h,
        judge.gradient,
    )
    weights = layer_weights(agent.critic, judge.online, 0)
    product(weights.T, critic.delta_h[0], agent.delta_inputs)

    inverse = _f(1) / np.exp(agent.rho.online[0])
    delta_rho = _f(0)
    for i in range(batch_size):
        mean = _f(0)
        for a in range(n_actions):
            mean += soft[a, i] * agent.delta_inputs[n_states + a, i]
        for a in range(n_actions):
            delta = soft[a, i] * (agent.delta_inputs[n_states + a, i] - mean)
            delta_rho -= delta * agent.logits[a, i]
            agent.delta_logits[a, i] = delta * inverse
    backward(
        agent.actor,
        agent.phi.online,
        batch.states,
        actor.h,
        actor.z,
        agent.delta_logits,
        actor.delta_h,
        agent.phi.gradient,
    )
    agent.steps[1] += 1
    _descend(agent.phi, agent.steps[1], settings.learning_rate)
    rho = agent.rho
    rho.gradient[0] = delta_rho
    _descend(rho, agent.steps[1], settings.learning_rate)
    lowest, highest = _f(settings.lowest_rho), _f(settings.highest_rho)
    rho.online[0] = min(max(rho.online[0], lowest), highest)


@compiled
def _descend(learned, step, learning_rate):
    adam_step(learned.online, learned.gradient, learned.first, learned.second, step, learning_rate)


@implements(TD3Kernel, learn)
@compiled
def gradient_step(agent, rng):
    """Make one step of the critics and, every `policy_delay` steps, one of the actor and of all
    targets; return the critics' loss."""
    loss = critic_step(agent, rng)
    if agent.steps[0] % agent.settings.policy_delay == 0:
        actor_step(agent, rng)
        rate = _f(agent.settings.target_update_rate)
        soft_update(agent.phi.target, agent.phi.online, rate)
        soft_update(agent.rho.target, agent.rho.online, rate)
        for c in range(2):
            soft_update(agent.theta[c].target, agent.theta[c].online, rate)
    return loss


@implements(TD3Kernel, greedy)
@compiled
def greedy_action(agent, state):
    """The action with the highest logit: the most probable one."""
    forward_single(agent.actor, agent.phi.online, state, agent.single_h, agent.single_logits)
    return np.argmax(agent.single_logits)


@implements(TD3Kernel, act)
@compiled
def explore(agent, state, exploring, rng):
    """The next training action: uniform in the initial episodes, then the argmax of a noisy
    relaxed action, whose whole vector is stored in `agent.action`."""
    action = agent.action
    if exploring:
        index = below(rng, action.size)
        action[:] = 0
        action[index] = 1
        return index
    forward_single(agent.actor, agent.phi.online, state, agent.single_h, agent.single_logits)
    logits = agent.single_logits.reshape(action.size, 1)
    relax(logits, agent.rho.online[0], 1, rng, action.reshape(action.size, 1))
    for a in range(action.size):
        action[a] += _f(agent.settings.action_noise) * normal(rng)
    return np.argmax(action)


@implements(TD3Kernel, end_episode)
@compiled
def rest(agent):
    """Do nothing."""
