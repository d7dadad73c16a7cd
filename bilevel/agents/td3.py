"""Definition of TD3 (Fujimoto et al., 2018) for discrete actions.

The paper gives the actor "a Gumbel-Softmax distribution with a learned temperature". An action is
then a relaxed one-hot vector, drawn as softmax((logits + g) / tau) with Gumbel noise g (Jang et
al., 2017), through which the critic's gradient reaches the actor. The environment receives its
argmax.

    actor, rho <- fresh actor, log of the temperature; critic 1, critic 2 <- fresh critics
    targets <- copies of all
    for each step:
        action <- any one-hot in the first init_episodes, then
                  relaxed action of the actor + N(0, action_noise^2)
        store (state, action, reward, next state, done)
        after init_episodes:
            minibatch from the replay buffer
            a' <- relaxed action of the target actor + clipped N(0, target_noise^2)
            goal <- reward + discount * (1 - done) * min of both target critics (next state, a')
            Adam step of both critics on their mean squared errors to goal
            every policy_delay steps:
                Adam step of actor and rho, uphill on critic 1 of the actor's relaxed actions
                targets <- targets + target_update_rate * (parameters - targets)

The paper leaves some details open. Noise, its clipping and the delay are those of Fujimoto et al.
Actions with noise are not clipped to [0, 1], as in the authors' code. The temperature is learned as
rho = log tau and clipped to [0.1, 10]: gradients vanish below, and actions become uniform above.
Tests take the action with the highest logit, the most probable one.

`bilevel.kernels.td3` is the compiled twin.
"""

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bilevel.agents.agent import Transition, agent_seeds
from bilevel.agents.modules import MLP, ReplayBuffer, flat_parameters, soft_update
from bilevel.hyperparameters import TD3Hyperparameters
from bilevel.networks import initial_parameters
from bilevel.splitmix import SplitMix64


class Actor(nn.Module):
    """Network of action logits, and rho, the logarithm of the temperature (a parameter)."""

    def __init__(self, net: MLP, temperature: float) -> None:
        super().__init__()
        self.net = net
        self.rho = nn.Parameter(torch.tensor([math.log(temperature)], dtype=torch.float32))

    def relaxed(self, states: Tensor, gumbel: Tensor) -> Tensor:
        """Relaxed one-hot actions (B, A) in states (B, S), given Gumbel noise (B, A)."""
        logits: Tensor = self.net(states)
        return torch.softmax((logits + gumbel) / self.rho.exp(), dim=-1)


class TD3:
    """A TD3 agent on discrete actions."""

    def __init__(self, hp: TD3Hyperparameters, state_size: int, n_actions: int, seed: int) -> None:
        initial_seed, loop_seed = agent_seeds(seed)
        self.hp, self.n_actions = hp, n_actions
        self.rng = SplitMix64(loop_seed)
        actor, critic = hp.networks(state_size, n_actions)
        initial = np.random.default_rng(initial_seed)
        vectors = [(net, initial_parameters(net, initial)) for net in (actor, critic, critic)]

        def copies() -> tuple[Actor, list[MLP]]:
            policy, *critics = (MLP(net, hp.activation, vector) for net, vector in vectors)
            return Actor(policy, hp.initial_temperature), critics

        self.actor, self.critics = copies()
        self.target_actor, self.target_critics = copies()
        of_critics = [p for critic in self.critics for p in critic.parameters()]
        self.critic_optimizer = torch.optim.Adam(of_critics, lr=hp.learning_rate)
        self.actor_optimizer = torch.optim.Adam(self.actor.parameters(), lr=hp.learning_rate)
        self.replay = ReplayBuffer(hp.replay_capacity)
        self.last_action = np.zeros(n_actions, np.float32)
        self.gradient_steps = 0

    def parameters(self) -> list[NDArray[np.float32]]:
        """Parameters of actor, rho and critics, then of their targets, in the twin's order."""
        parts: list[NDArray[np.float32]] = []
        for actor, critics in (
            (self.actor, self.critics),
            (self.target_actor, self.target_critics),
        ):
            parts += [flat_parameters(actor.net), actor.rho.detach().numpy()]
            parts += map(flat_parameters, critics)
        return parts

    def _gumbel(self, rows: int) -> Tensor:
        noise = self.rng.gumbel(rows * self.n_actions)
        return torch.from_numpy(noise.reshape(rows, self.n_actions))

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """Choose a uniform action while exploring, then the argmax of a noisy relaxed action."""
        if exploring:
            self.last_action = np.zeros(self.n_actions, np.float32)
            self.last_action[self.rng.below(self.n_actions, 1)[0]] = 1
        else:
            with torch.no_grad():
                soft = self.actor.relaxed(torch.from_numpy(state)[None], self._gumbel(1))[0]
            noise = np.float32(self.hp.action_noise) * self.rng.normal(self.n_actions)
            self.last_action = soft.numpy() + noise
        return int(self.last_action.argmax())

    def greedy(self, state: NDArray[np.float32]) -> int:
        """The action with the highest logit."""
        with torch.no_grad():
            return int(self.actor.net(torch.from_numpy(state)).argmax())

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
        hp, rows = self.hp, len(states)
        with torch.no_grad():
            smooth = self.target_actor.relaxed(next_states, self._gumbel(rows))
            noise = np.float32(hp.target_noise) * self.rng.normal(rows * self.n_actions)
            noise = noise.clip(-hp.target_noise_clip, hp.target_noise_clip)
            smooth += torch.from_numpy(noise.astype(np.float32)).view(rows, self.n_actions)
            inputs = torch.cat([next_states, smooth], dim=1)
            one, two = (critic(inputs).squeeze(1) for critic in self.target_critics)
            goal = rewards + hp.discount * (1 - dones) * torch.minimum(one, two)
        inputs = torch.cat([states, actions], dim=1)
        one, two = (critic(inputs).squeeze(1) for critic in self.critics)
        loss = nn.functional.mse_loss(one, goal) + nn.functional.mse_loss(two, goal)
        self.critic_optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.critic_optimizer.step()
        self.gradient_steps += 1
        if self.gradient_steps % hp.policy_delay == 0:
            self._actor_step(states)
        return float(loss.detach())

    def _actor_step(self, states: Tensor) -> None:
        soft = self.actor.relaxed(states, self._gumbel(len(states)))
        value = self.critics[0](torch.cat([states, soft], dim=1))
        self.actor_optimizer.zero_grad()
        (-value.mean()).backward()
        self.actor_optimizer.step()
        with torch.no_grad():
            self.actor.rho.clamp_(*(math.log(t) for t in self.hp.temperatures))
        targets = (self.target_actor, *self.target_critics)
        for target, online in zip(targets, (self.actor, *self.critics), strict=True):
            soft_update(target, online, self.hp.target_update_rate)

    def end_episode(self) -> None:
        """Do nothing."""
