"""Definition of TD3 (Fujimoto et al., 2018) for discrete actions: `bilevel.agents.td3` with another
actor.

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

`bilevel.kernels.td3_discrete` is the compiled twin.
"""

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bilevel.agents.modules import MLP, flat_parameters
from bilevel.agents.td3 import TD3


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


class DiscreteTD3(TD3):
    """A TD3 agent on discrete actions."""

    def new_actor(self, net: MLP) -> nn.Module:
        """Return the actor with this network."""
        return Actor(net, self.hp.initial_temperature)

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

    def actions(self, actor: Any, states: Tensor) -> Tensor:
        """Relaxed actions (B, A) of an actor in states (B, S)."""
        gumbel = self.rng.gumbel(len(states) * self.action_size)
        noise = torch.from_numpy(gumbel).view(-1, self.action_size)
        relaxed: Tensor = actor.relaxed(states, noise)
        return relaxed

    def target_actions(self, next_states: Tensor) -> Tensor:
        """Relaxed actions (B, A) of the target actor in states (B, S), plus clipped noise."""
        soft = self.actions(self.target_actor, next_states)
        return soft + self.target_noise(len(soft))

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """Choose a uniform action while exploring, then the argmax of a noisy relaxed action."""
        if exploring:
            self.last_action = np.zeros(self.action_size, np.float32)
            self.last_action[self.rng.below(self.action_size, 1)[0]] = 1
        else:
            with torch.no_grad():
                soft = self.actions(self.actor, torch.from_numpy(state)[None])[0]
            noise = np.float32(self.hp.action_noise) * self.rng.normal(self.action_size)
            self.last_action = soft.numpy() + noise
        return int(self.last_action.argmax())

    def greedy(self, state: NDArray[np.float32]) -> int:
        """The action with the highest logit."""
        with torch.no_grad():
            return int(self.actor.net(torch.from_numpy(state)).argmax())

    def actor_step(self, states: Tensor) -> None:
        """Make one Adam step of actor and temperature, and clip the temperature."""
        super().actor_step(states)
        with torch.no_grad():
            self.actor.rho.clamp_(*(math.log(t) for t in self.hp.temperatures))
