"""Definition of PPO (Schulman et al., 2017) for discrete and continuous actions.

    policy, value <- fresh networks, orthogonal, with a nearly uniform policy
    for each step:
        action <- sample of pi(. | state): softmax(policy), or N(policy, exp(scale)^2)
        append (state, action, reward, next state, done) to the rollout
        after rollout_steps transitions:
            d_t <- reward_t + discount * (1 - done_t) * value(next state_t) - value(state_t)
            A_t <- d_t + discount * lambda * A_{t+1}, or d_t at the end of an episode
            repeat epochs times, for each minibatch of the shuffled rollout:
                A   <- (A - mean A) / std A
                rho <- pi(action | state) / pi_old(action | state)
                Adam step of the policy, uphill on mean min(rho A, clip(rho, 1 +- clip) A)
                    + entropy * mean entropy of pi
                Adam step of the value on its mean squared error to A_t + value_old(state_t)

It has these details of Huang et al. (2022, "The 37 Implementation Details of PPO"): orthogonal
initialisation, generalized advantage estimation, normalized advantages of minibatches, bounded
gradient norms, separate networks, and for continuous actions a scale that does not depend on the
state. Episodes that a step limit truncates are bootstrapped. Actions are clipped to [-1, 1] outside
of the agent.

`bilevel.kernels.ppo` is the compiled twin.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bilevel.agents.agent import Transition, agent_seeds
from bilevel.agents.modules import MLP, flat_parameters
from bilevel.hyperparameters import PPOHyperparameters
from bilevel.networks import orthogonal_parameters
from bilevel.spaces import Action
from bilevel.splitmix import SplitMix64


class PPO:
    """A PPO agent for discrete actions."""

    continuous = False

    def __init__(
        self, hp: PPOHyperparameters, state_size: int, action_size: int, seed: int
    ) -> None:
        initial_seed, loop_seed = agent_seeds(seed)
        self.hp = hp
        self.rng = SplitMix64(loop_seed)
        initial = np.random.default_rng(initial_seed)
        self.policy, self.value = (
            MLP(net, hp.activation, orthogonal_parameters(net, initial, gain))
            for net, gain in zip(hp.networks(state_size, action_size), hp.output_gains, strict=True)
        )
        self.scale = nn.Parameter(torch.zeros(action_size))
        learned = [*self.policy.parameters(), self.scale], [*self.value.parameters()]
        self.optimizers = [
            (parameters, torch.optim.Adam(parameters, lr=hp.learning_rate))
            for parameters in learned
        ]
        self.action = np.zeros(0, np.float32)
        self.last: Transition | None = None
        self.rollout: list[Transition] = []
        self.actions: list[NDArray[np.float32]] = []
        self.ends: list[bool] = []

    def parameters(self) -> list[NDArray[np.float32]]:
        """Flat parameters of policy and value, and the scale, in the twin's order."""
        scale = [self.scale.detach().numpy()] if self.continuous else []
        return [flat_parameters(self.policy), flat_parameters(self.value), *scale]

    def act(self, state: NDArray[np.float32], exploring: bool) -> Action:
        """Sample an action, also in the initial episodes."""
        with torch.no_grad():
            outputs = self.policy(torch.from_numpy(state)).numpy()
        return self.sample(outputs)

    def sample(self, outputs: NDArray[np.float32]) -> Action:
        """Sample from softmax(outputs), by Gumbel noise."""
        index = int((outputs + self.rng.gumbel(outputs.size)).argmax())
        self.action = np.array([index], np.float32)
        return index

    def greedy(self, state: NDArray[np.float32]) -> Action:
        """The most probable action."""
        with torch.no_grad():
            return int(self.policy(torch.from_numpy(state)).argmax())

    def log_probabilities(self, outputs: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Return log pi (B,) of actions (B, M), and the mean entropy of pi."""
        logs = torch.log_softmax(outputs, dim=1)
        entropy = -(logs.exp() * logs).sum(dim=1).mean()
        return logs.gather(1, actions.long()).squeeze(1), entropy

    def observe(self, transition: Transition) -> None:
        """Keep the transition for `learn`."""
        self.last = transition

    def learn(self) -> float:
        """Append the last transition to the rollout, and learn from it once it is complete; return
        the last minibatch's squared error of values, 0 before."""
        assert self.last is not None
        self.rollout.append(self.last)
        self.actions.append(self.action)
        self.ends.append(False)
        if len(self.rollout) < self.hp.rollout_steps:
            return 0.0
        loss = self.update()
        self.rollout, self.actions, self.ends = [], [], []
        return loss

    def end_episode(self) -> None:
        """Mark the end of an episode in the rollout."""
        if self.ends:
            self.ends[-1] = True

    def update(self) -> float:
        """Learn from the rollout; return the last minibatch's squared error of values."""
        hp = self.hp
        states, next_states = (
            torch.from_numpy(np.stack([getattr(t, name) for t in self.rollout]))
            for name in ("state", "next_state")
        )
        actions = torch.from_numpy(np.stack(self.actions))
        with torch.no_grad():
            values = self.value(states).squeeze(1)
            after = self.value(next_states).squeeze(1)
            old, _ = self.log_probabilities(self.policy(states), actions)
        advantages = self.advantages(values, after)
        goals = advantages + values
        loss = 0.0
        for _ in range(hp.epochs):
            order = self.shuffled(hp.rollout_steps)
            for start in range(0, hp.rollout_steps - hp.minibatch + 1, hp.minibatch):
                rows = torch.from_numpy(order[start : start + hp.minibatch])
                loss = self.gradient_step(
                    states[rows], actions[rows], old[rows], advantages[rows], goals[rows]
                )
        return loss

    def advantages(self, values: Tensor, after: Tensor) -> Tensor:
        """Generalized advantage estimates (N,) of the rollout, given the values of states (N,) and
        of next states (N,)."""
        hp, found, following = self.hp, torch.zeros_like(values), 0.0
        for t in range(len(self.rollout) - 1, -1, -1):
            transition = self.rollout[t]
            kept = hp.discount * (1 - float(np.float32(transition.done)))
            difference = transition.reward + kept * float(after[t]) - float(values[t])
            following = difference + (
                0.0 if self.ends[t] else hp.discount * hp.advantage_decay * following
            )
            found[t] = following
        return found

    def shuffled(self, size: int) -> NDArray[np.int64]:
        """A random order of `size` numbers (Fisher and Yates)."""
        order = np.arange(size)
        for last in range(size - 1, 0, -1):
            other = int(self.rng.below(last + 1, 1)[0])
            order[last], order[other] = order[other], order[last]
        return order

    def gradient_step(
        self, states: Tensor, actions: Tensor, old: Tensor, advantages: Tensor, goals: Tensor
    ) -> float:
        """Make one Adam step of policy and value; return the squared error of values. Takes states
        (B, S), actions (B, M), log pi_old (B,), advantages (B,) and goals of values (B,)."""
        hp = self.hp
        logs, entropy = self.log_probabilities(self.policy(states), actions)
        ratios = (logs - old).exp()
        normal = (advantages - advantages.mean()) / (advantages.std(correction=0) + 1e-8)
        clipped = ratios.clamp(1 - hp.clip, 1 + hp.clip)
        gain = torch.minimum(ratios * normal, clipped * normal).mean() + hp.entropy * entropy
        error = nn.functional.mse_loss(self.value(states).squeeze(1), goals)
        for (parameters, optimizer), loss in zip(
            self.optimizers, (-gain, 0.5 * error), strict=True
        ):
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(parameters, hp.gradient_norm)
            optimizer.step()
        return float(error.detach())


class ContinuousPPO(PPO):
    """A PPO agent for continuous actions."""

    continuous = True

    def sample(self, outputs: NDArray[np.float32]) -> Action:
        """Sample from N(outputs, exp(scale)^2)."""
        noise = self.rng.normal(outputs.size)
        self.action = outputs + np.exp(self.scale.detach().numpy()) * noise
        return self.action.clip(-1, 1)

    def greedy(self, state: NDArray[np.float32]) -> Action:
        """The mean, clipped to [-1, 1]."""
        with torch.no_grad():
            mean: NDArray[np.float32] = self.policy(torch.from_numpy(state)).numpy()
        return mean.clip(-1, 1)

    def log_probabilities(self, outputs: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Return log pi (B,) of actions (B, M) up to a constant, and pi's entropy likewise."""
        z = (actions - outputs) * torch.exp(-self.scale)
        return (-0.5 * z * z - self.scale).sum(dim=1), self.scale.sum()
