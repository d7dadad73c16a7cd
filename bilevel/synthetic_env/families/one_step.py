"""The one-step family: an initial state, an action, a reward, and the end of the episode.

SEs that are learned freely often become contextual bandits (Liesen et al., 2024, "Discovering
Minimal Reinforcement Learning Environments"). In this family they are bandits from the start. NES
moves all weights of the reward network; states are normal, with mean and scale of the observations
under random actions, so that an agent sees all of them. Only the initialisation is designed: hidden
units form pairs, and each pair rewards one action input near a random linear function of the state,

    w [tanh(k (a_j - l x) + d) - tanh(k (a_j - l x) - d)]

so that a random SE has a best action that depends on the state. The input a_j is a dimension of a
continuous action, or 1 for the discrete action j, else 0. A pair is one bump, and NES may change
its units independently.

symbol     shape        meaning
--------   ----------   ------------------------------------------------------------
genotype   (D,)         all parameters of the reward network, in units of their scale
x          (S,)         state in units of the observations' scale
k, d, l    -            STEEPNESS, WIDTH, and a random row of scale LINEAR / sqrt(S)
H          -            number of hidden units; pair i rewards input i mod A
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from bilevel.errors import InvalidInput
from bilevel.evolution import Genotype
from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env.architecture import Architecture, Psi
from bilevel.tasks import ObservationScale

#: Steepness and half-width of a bump, scale of its linear function, and scale of the rewards.
STEEPNESS, WIDTH, LINEAR, HEIGHT = 0.4, 0.5, 1.5, 8.0


@dataclass(frozen=True)
class OneStepFamily:
    """See the module."""

    architecture: Architecture
    scale: ObservationScale
    spread: float  # of the states, in units of the observations' scale

    @classmethod
    def build(
        cls, architecture: Architecture, scale: ObservationScale, hp: SEHyperparameters
    ) -> Self:
        """Return the family, with an even number of units, at least two for each action input.
        Raises InvalidInput for networks that cannot hold it."""
        if (architecture.hidden_layers, architecture.activation) != (1, "tanh"):
            raise InvalidInput("se.family 'one-step' needs se.hidden_layers 1, se.activation tanh")
        hidden_size = 2 * max(-(-architecture.hidden_size // 2), architecture.action_size)
        one_step = replace(
            architecture, hidden_size=hidden_size, step_limit=1, own_initial_states=True
        )
        return cls(one_step, scale, hp.spread)

    @property
    def _units(self) -> tuple[int, int, int]:
        """H, S and A."""
        arch = self.architecture
        return arch.hidden_size, arch.state_size, arch.action_size

    @property
    def size(self) -> int:
        """D."""
        units, states, actions = self._units
        return units * (states + actions + 2) + 1

    def initialize(self, rng: np.random.Generator) -> Genotype:
        """Draw random bumps."""
        units, states, actions = self._units
        genotype = np.zeros(self.size, np.float32)
        of_state, of_action, bias, output, _ = self._parts(genotype)
        of_state[...] = rng.standard_normal((units // 2, states), np.float32).repeat(2, axis=0)
        first = np.arange(units) // 2 % actions
        of_action[np.arange(units), first] = 1
        bias[0::2], bias[1::2] = 1, -1
        output[0::2], output[1::2] = 1, -1
        return genotype

    def psi(self, genotype: Genotype) -> Psi:
        """Write a genotype (D,) into the networks."""
        units, states, actions = self._units
        of_state, of_action, bias, output, constant = self._parts(genotype)
        mean, deviation = self.scale.mean, self.scale.deviation
        psi = np.zeros(self.architecture.parameter_count, np.float32)
        tensors = self.architecture.tensors(psi)
        raw = -np.float32(STEEPNESS * LINEAR / math.sqrt(states)) * of_state / deviation
        weights = tensors["reward.0.weight"]
        weights[:, :actions], weights[:, actions:] = np.float32(STEEPNESS) * of_action, raw
        tensors["reward.0.bias"][...] = np.float32(WIDTH) * bias - raw @ mean
        tensors["reward.1.weight"][0] = np.float32(HEIGHT / math.sqrt(units / 2)) * output
        # The reward of the best actions is 0: critics learn a large constant slowly.
        peak = 2 * HEIGHT * math.sqrt(units / 2) * math.tanh(WIDTH)
        tensors["reward.1.bias"][...] = constant - np.float32(peak)
        tensors["next_state.1.bias"][...] = mean
        tensors["done.1.bias"][...] = 1
        tensors["initial_state.0.weight"][...] = np.diag(np.float32(self.spread) * deviation)
        tensors["initial_state.0.bias"][...] = mean
        return psi

    def _parts(self, genotype: Genotype) -> tuple[Genotype, ...]:
        """Return views of a genotype: weights of states (H, S), of actions (H, A), biases (H,),
        output weights (H,) and output bias (1,)."""
        units, states, actions = self._units
        sizes = [units * states, units * actions, units, units]
        of_state, of_action, bias, output, constant = np.split(genotype, np.cumsum(sizes))
        shapes = (units, states), (units, actions)
        return of_state.reshape(shapes[0]), of_action.reshape(shapes[1]), bias, output, constant
