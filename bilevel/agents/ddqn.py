"""Double DQN (van Hasselt et al., 2016), the definition.

    theta <- fresh Q-network; target <- theta
    for each episode:
        epsilon <- initial_epsilon, then times epsilon_decay down to minimal_epsilon
        for each step:
            action <- random with probability epsilon, else argmax_a Q_theta(state, a)
            store (state, action, reward, next state, done)
            once init_episodes are over:
                minibatch from the replay buffer
                a* <- argmax_a Q_theta(next state, a)
                goal <- reward + discount * (1 - done) * Q_target(next state, a*)
                Adam step on the mean squared error of Q_theta(state, action) to goal
                target <- target + target_update_rate * (theta - target)
        stop if the environment's stopping rule says so

`bilevel.kernels.ddqn` is its compiled twin: both draw the same numbers in the same
order, and a test holds them together through whole training runs.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.kernels.random import SplitMix64
from bilevel.synthetic_env.torch_module import activation_module


class QNetwork(nn.Module):
    """MLP from states (..., S) to action values (..., A); one activation module,
    and so one PReLU slope, serves all hidden layers."""

    def __init__(self, state_size: int, n_actions: int, hp: DDQNHyperparameters) -> None:
        super().__init__()
        sizes = [state_size, *[hp.hidden_size] * hp.hidden_layers, n_actions]
        self.layers = nn.ModuleList(nn.Linear(n_in, n_out) for n_in, n_out in pairwise(sizes))
        self.activation = activation_module(hp.activation)

    def forward(self, x: Tensor) -> Tensor:
        """Action values."""
        for layer in self.layers[:-1]:
            x = self.activation(layer(x))
        values: Tensor = self.layers[-1](x)
        return values


class TrainingEnvironment(Protocol):
    """What the agent trains on: an SE or a real task."""

    def reset(self, episode: int) -> NDArray[np.float32]:
        """The initial state (S,) of an episode."""

    def step(self, action: int) -> tuple[NDArray[np.float32], float, float]:
        """Next state (S,), reward, raw done (ends the episode above 0.5)."""


#: Told the returns of the episodes so far, decides whether training is over.
StoppingRule = Callable[[list[float]], bool]


@dataclass
class DDQN:
    """A DDQN agent.

    `theta` (P,) float32 are the initial parameters; `rng` decides on exploration
    and minibatches.
    """

    hp: DDQNHyperparameters
    state_size: int
    n_actions: int
    theta: NDArray[np.float32]
    rng: SplitMix64
    steps: int = field(default=0, init=False)  # environment steps so far

    def __post_init__(self) -> None:
        self.online = QNetwork(self.state_size, self.n_actions, self.hp)
        self.target = QNetwork(self.state_size, self.n_actions, self.hp)
        for net in (self.online, self.target):
            nn.utils.vector_to_parameters(torch.from_numpy(self.theta.copy()), net.parameters())
        self.optimizer = torch.optim.Adam(self.online.parameters(), lr=self.hp.learning_rate)
        self.replay: list[tuple[NDArray[np.float32], int, float, NDArray[np.float32], float]] = []

    def parameters(self) -> NDArray[np.float32]:
        """The online network's parameters (P,), in the twin's order."""
        vector = nn.utils.parameters_to_vector(self.online.parameters())
        array: NDArray[np.float32] = vector.detach().numpy()
        return array

    def act(self, state: NDArray[np.float32]) -> int:
        """The greedy action."""
        with torch.no_grad():
            return int(self.online(torch.from_numpy(state)).argmax())

    def store(
        self,
        state: NDArray[np.float32],
        action: int,
        reward: float,
        next_state: NDArray[np.float32],
        done: float,
    ) -> None:
        """Remember a transition; the oldest one gives way when the buffer is full."""
        transition = (state.copy(), action, reward, next_state.copy(), done)
        if len(self.replay) < self.hp.replay_capacity:
            self.replay.append(transition)
        else:
            self.replay[self.steps % self.hp.replay_capacity] = transition
        self.steps += 1

    def learn(self) -> float:
        """One gradient step on a minibatch drawn with replacement; returns the loss."""
        rows = [self.replay[i] for i in self.rng.below(len(self.replay), self.hp.batch_size)]
        states, actions, rewards, next_states, dones = zip(*rows, strict=True)
        return self.gradient_step(
            torch.from_numpy(np.array(states)),
            torch.tensor(actions),
            torch.tensor(rewards, dtype=torch.float32),
            torch.from_numpy(np.array(next_states)),
            torch.tensor(dones, dtype=torch.float32),
        )

    def gradient_step(
        self, states: Tensor, actions: Tensor, rewards: Tensor, next_states: Tensor, dones: Tensor
    ) -> float:
        """One Adam step and soft update on states (B, S), actions (B,), rewards (B,),
        next states (B, S) and raw dones (B,); returns the mean squared error."""
        with torch.no_grad():
            best = self.online(next_states).argmax(dim=1, keepdim=True)
            value = self.target(next_states).gather(1, best).squeeze(1)
            goal = rewards + self.hp.discount * (1 - dones) * value
        q = self.online(states).gather(1, actions.unsqueeze(1)).squeeze(1)
        loss = nn.functional.mse_loss(q, goal)
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        with torch.no_grad():
            pairs = zip(self.target.parameters(), self.online.parameters(), strict=True)
            for target, online in pairs:
                target.lerp_(online, self.hp.target_update_rate)
        return float(loss.detach())

    def train(
        self, environment: TrainingEnvironment, step_limit: int, stop: StoppingRule
    ) -> list[float]:
        """Train until `stop` says so, the numbers diverge, or the episodes are
        spent; returns the episodes' returns."""
        returns: list[float] = []
        epsilon = self.hp.initial_epsilon
        for episode in range(self.hp.max_episodes):
            state = environment.reset(episode)
            total = 0.0
            for _ in range(step_limit):
                if self.rng.uniform() < epsilon:
                    action = int(self.rng.below(self.n_actions, 1)[0])
                else:
                    action = self.act(state)
                next_state, reward, done = environment.step(action)
                if not np.isfinite([*next_state, reward, done]).all():
                    return returns
                self.store(state, action, reward, next_state, done)
                state = next_state
                total += reward
                if episode >= self.hp.init_episodes and not np.isfinite(self.learn()):
                    return returns
                if done > 0.5:
                    break
            returns.append(total)
            epsilon = max(epsilon * self.hp.epsilon_decay, self.hp.minimal_epsilon)
            if stop(returns):
                break
        return returns
