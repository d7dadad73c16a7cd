"""Definition of TD3 (Fujimoto et al., 2018) for continuous actions.

    actor <- fresh actor; critic 1, critic 2 <- fresh critics; targets <- copies of all
    for each step:
        action <- uniform in [-1, 1] in the first init_episodes, then
                  clip(tanh(actor(state)) + N(0, action_noise^2), -1, 1)
        store (state, action, reward, next state, done)
        after init_episodes:
            minibatch from the replay buffer
            a' <- clip(tanh(target actor(next state)) + clipped N(0, target_noise^2), -1, 1)
            goal <- reward + discount * (1 - done) * min of both target critics (next state, a')
            Adam step of both critics on their mean squared errors to goal
            every policy_delay steps:
                Adam step of the actor, uphill on critic 1 of the actor's actions
                targets <- targets + target_update_rate * (parameters - targets)

`bilevel.kernels.td3` is the compiled twin. `bilevel.agents.td3_discrete` has another actor.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bilevel.agents.agent import Transition, agent_seeds
from bilevel.agents.modules import MLP, ReplayBuffer, flat_parameters, soft_update
from bilevel.hyperparameters import TD3Hyperparameters
from bilevel.networks import initial_parameters
from bilevel.spaces import Action
from bilevel.splitmix import SplitMix64


class TD3:
    """A TD3 agent."""

    def __init__(
        self, hp: TD3Hyperparameters, state_size: int, action_size: int, seed: int
    ) -> None:
        initial_seed, loop_seed = agent_seeds(seed)
        self.hp, self.action_size = hp, action_size
        self.rng = SplitMix64(loop_seed)
        actor, critic = hp.networks(state_size, action_size)
        initial = np.random.default_rng(initial_seed)
        vectors = [(net, initial_parameters(net, initial)) for net in (actor, critic, critic)]

        def copies() -> tuple[Any, list[MLP]]:
            policy, *critics = (MLP(net, hp.activation, vector) for net, vector in vectors)
            return self.new_actor(policy), critics

        self.actor, self.critics = copies()
        self.target_actor, self.target_critics = copies()
        of_critics = [p for critic in self.critics for p in critic.parameters()]
        self.critic_optimizer = torch.optim.Adam(of_critics, lr=hp.learning_rate)
        self.actor_optimizer = torch.optim.Adam(self.actor.parameters(), lr=hp.learning_rate)
        self.replay = ReplayBuffer(hp.replay_capacity)
        self.last_action = np.zeros(action_size, np.float32)
        self.gradient_steps = 0

    def new_actor(self, net: MLP) -> nn.Module:
        """Return the actor with this network."""
        return net

    def parameters(self) -> list[NDArray[np.float32]]:
        """Parameters of actor and critics, then of their targets, in the twin's order."""
        parts = (self.actor, *self.critics, self.target_actor, *self.target_critics)
        return [flat_parameters(part) for part in parts]

    def actions(self, actor: Any, states: Tensor) -> Tensor:
        """Actions (B, A) of an actor in states (B, S)."""
        return torch.tanh(actor(states))

    def target_actions(self, next_states: Tensor) -> Tensor:
        """Smoothed actions (B, A) of the target actor in states (B, S)."""
        best = self.actions(self.target_actor, next_states)
        return (best + self.target_noise(len(best))).clamp(-1, 1)

    def target_noise(self, rows: int) -> Tensor:
        """Clipped noise (rows, A) of target smoothing."""
        noise = np.float32(self.hp.target_noise) * self.rng.normal(rows * self.action_size)
        noise = noise.clip(-self.hp.target_noise_clip, self.hp.target_noise_clip)
        return torch.from_numpy(noise.astype(np.float32)).view(rows, self.action_size)

    def act(self, state: NDArray[np.float32], exploring: bool) -> Action:
        """Choose a uniform action while exploring, then the actor's with noise."""
        if exploring:
            uniforms = [self.rng.uniform() for _ in range(self.action_size)]
            self.last_action = (2 * np.array(uniforms) - 1).astype(np.float32)
        else:
            noise = np.float32(self.hp.action_noise) * self.rng.normal(self.action_size)
            self.last_action = (self.greedy(state) + noise).clip(-1, 1)
        return self.last_action

    def greedy(self, state: NDArray[np.float32]) -> Any:
        """The actor's action."""
        with torch.no_grad():
            return self.actions(self.actor, torch.from_numpy(state)[None])[0].numpy()

    def observe(self, transition: Transition) -> None:
        """Store the transition with the whole action vector."""
        state, _, reward, next_state, done = transition
        self.replay.store(state, self.last_action, reward, next_state, done)

    def learn(self) -> float:
        """Make one gradient step on a minibatch; return the critics' loss."""
        return self.gradient_step(*self.replay.sample(self.hp.batch_size, self.rng))

    def gradient_step(
        self, states: Tensor, actions: Tensor, rewards: Tensor, next_states: Tensor, dones: Tensor
    ) -> float:
        """Make one critic step, and every `policy_delay` steps an actor step; return the critics'
        loss. Takes states (B, S), actions (B, A), rewards (B,), next states (B, S), raw dones (B,).
        """
        with torch.no_grad():
            inputs = torch.cat([next_states, self.target_actions(next_states)], dim=1)
            one, two = (critic(inputs).squeeze(1) for critic in self.target_critics)
            goal = rewards + self.hp.discount * (1 - dones) * torch.minimum(one, two)
        inputs = torch.cat([states, actions], dim=1)
        one, two = (critic(inputs).squeeze(1) for critic in self.critics)
        loss = nn.functional.mse_loss(one, goal) + nn.functional.mse_loss(two, goal)
        self.critic_optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.critic_optimizer.step()
        self.gradient_steps += 1
        if self.gradient_steps % self.hp.policy_delay == 0:
            self.actor_step(states)
            targets = (self.target_actor, *self.target_critics)
            for target, online in zip(targets, (self.actor, *self.critics), strict=True):
                soft_update(target, online, self.hp.target_update_rate)
        return float(loss.detach())

    def actor_step(self, states: Tensor) -> None:
        """Make one Adam step of the actor, uphill on critic 1, in states (B, S)."""
        value = self.critics[0](torch.cat([states, self.actions(self.actor, states)], dim=1))
        self.actor_optimizer.zero_grad()
        (-value.mean()).backward()
        self.actor_optimizer.step()

    def end_episode(self) -> None:
        """Do nothing."""
