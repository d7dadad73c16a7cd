"""Definition of Double DQN (van Hasselt et al., 2016) and Dueling Double DQN (Wang et al., 2016).

    theta <- fresh Q-network; target <- theta
    for each episode:
        epsilon <- initial_epsilon, then times epsilon_decay down to minimal_epsilon
        for each step:
            action <- random with probability epsilon, else argmax_a Q_theta(state, a)
            store (state, action, reward, next state, done)
            after init_episodes:
                minibatch from the replay buffer
                a* <- argmax_a Q_theta(next state, a)
                goal <- reward + discount * (1 - done) * Q_target(next state, a*)
                Adam step on the mean squared error of Q_theta(state, action) to goal
                target <- target + target_update_rate * (theta - target)

A dueling network has Q(s, a) = V(s) + A(s, a) - mean_a' A(s, a'). The paper leaves its sizes open.
Here `hidden_layers` shared layers are followed by one of which half the units feed the value and
half the advantages. So each stream has its own layer, as in Wang et al.

`bilevel.kernels.ddqn` is the compiled twin: both draw the same random numbers in the same order,
and a test compares them over whole training runs.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bilevel.agents.agent import Transition, agent_seeds
from bilevel.agents.modules import MLP, ReplayBuffer, flat_parameters, soft_update
from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.networks import initial_parameters
from bilevel.splitmix import SplitMix64


class DDQN:
    """A DDQN agent; `hp.dueling` selects the dueling network."""

    def __init__(
        self, hp: DDQNHyperparameters, state_size: int, action_size: int, seed: int
    ) -> None:
        initial_seed, loop_seed = agent_seeds(seed)
        self.hp, self.action_size = hp, action_size
        self.rng = SplitMix64(loop_seed)
        net = hp.network(state_size, action_size)
        theta = initial_parameters(net, np.random.default_rng(initial_seed))
        self.online, self.target = (MLP(net, hp.activation, theta) for _ in range(2))
        self.optimizer = torch.optim.Adam(self.online.parameters(), lr=hp.learning_rate)
        self.replay = ReplayBuffer(hp.replay_capacity)
        self.epsilon = hp.initial_epsilon

    def parameters(self) -> list[NDArray[np.float32]]:
        """Flat parameters of the online and the target network, in the twin's order."""
        return [flat_parameters(self.online), flat_parameters(self.target)]

    def values(self, network: MLP, states: Tensor) -> Tensor:
        """Action values (..., A) of states (..., S)."""
        outputs: Tensor = network(states)
        if not self.hp.dueling:
            return outputs
        value, advantages = outputs[..., :1], outputs[..., 1:]
        return value + advantages - advantages.mean(dim=-1, keepdim=True)

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """Choose a random action with probability epsilon, else the greedy one."""
        if self.rng.uniform() < self.epsilon:
            return int(self.rng.below(self.action_size, 1)[0])
        return self.greedy(state)

    def greedy(self, state: NDArray[np.float32]) -> int:
        """The action with the highest value."""
        with torch.no_grad():
            return int(self.values(self.online, torch.from_numpy(state)).argmax())

    def observe(self, transition: Transition) -> None:
        """Store the transition."""
        state, action, reward, next_state, done = transition
        self.replay.store(state, np.array([action], np.float32), reward, next_state, done)

    def learn(self) -> float:
        """Make one gradient step on a minibatch; return the mean squared error."""
        return self.gradient_step(*self.replay.sample(self.hp.batch_size, self.rng))

    def gradient_step(
        self, states: Tensor, actions: Tensor, rewards: Tensor, next_states: Tensor, dones: Tensor
    ) -> float:
        """Make one Adam step and soft update; return the mean squared error. Takes states (B, S),
        actions (B, 1), rewards (B,), next states (B, S), raw dones (B,)."""
        with torch.no_grad():
            best = self.values(self.online, next_states).argmax(dim=1, keepdim=True)
            value = self.values(self.target, next_states).gather(1, best).squeeze(1)
            goal = rewards + self.hp.discount * (1 - dones) * value
        q = self.values(self.online, states).gather(1, actions.long()).squeeze(1)
        loss = nn.functional.mse_loss(q, goal)
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        soft_update(self.target, self.online, self.hp.target_update_rate)
        return float(loss.detach())

    def end_episode(self) -> None:
        """Decay epsilon."""
        self.epsilon = max(self.epsilon * self.hp.epsilon_decay, self.hp.minimal_epsilon)
