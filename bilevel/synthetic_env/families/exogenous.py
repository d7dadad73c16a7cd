"""The exogenous family: next states ignore the action, and rewards compare actions.

The family is designed by hand (docs/nes.md): random plain SEs prefer the same action nearly
everywhere, and their states stay close to one point, so that agents learn nothing. In this family

    x   = (s - m) / c                                     m, c: mean and scale of observations
    s'  = m + c * (f Q W^+ tanh(W x + b) + v)             the same for all actions
    Q   = B' R(phi) B                                     rotates x by the angles phi
    G   = L x + U tanh(R x + d)                           A_a = G_a - mean of G over actions
    r(s, a) = A_a(x) - A_a(0)
    done  exceeds its threshold where a component of x leaves +-E

Rewards whose mean over actions is zero in all states only rank actions, and no action is preferred
at the mean observation. An untrained agent then earns about nothing, so the stopping rule ends
training only once there is something to lose. The action of the highest reward is optimal for every
discount: such SEs are contextual bandits, like many freely learned SEs (Liesen et al., 2024,
"Discovering Minimal Reinforcement Learning Environments").

Q rotates x in S // 2 planes, each by a different angle that is not small. If S is odd, the last
component changes its sign: a component that keeps its sign shows the agent only one side of the
reward. Episodes that end at the border of the usual observations keep returns small, and so the
errors of bootstrapped values. m and c are measured under random actions (`Task.observation_scale`).

symbol     shape            meaning
--------   --------------   ----------------------------------------------------------
genotype   (D,)             all parameters: normal in a random SE, biases zero
W, W^+     (H, S), (S, H)   next state; W^+ is the pseudoinverse of W
B          (S, S)           the nearest orthogonal matrix defines the planes of Q
phi        (S // 2,)        angles of Q, from MIN_ANGLE to pi - MIN_ANGLE
L          (A, S)           linear part of the reward
R, U       (K, S), (A, K)   nonlinear part of the reward, K = H // A - 2
E          (S,)             half-widths of the box in which an episode continues
f          -                `se.spread`
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.evolution import Genotype
from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env.architecture import Architecture, Psi
from bilevel.tasks import ObservationScale

#: Magnitude of x's components at which tanh saturates.
RANGE = 3.0
#: Half-width of a random SE's box in units of c, and the steepness of done at its sides.
EDGE, SIDES = 2.0, 2.0
#: Scale of the reward's linear and nonlinear part, and the steepness of the nonlinear part's units.
#: The linear part is larger: it has few parameters, and agents interpolate it well.
LINEAR, BEND, STEEPNESS = 1.0, 0.5, 1.5
#: Factor that scales the input of a tanh unit so that the unit is nearly linear.
NEARLY = 0.02
#: Scale of biases.
BIAS = 0.3
#: Genes of the next state and the box are this much larger than the others, so that perturbations
#: change them less. If all genes move alike, runs drift to episodes of a few steps.
INERTIA = 4.0
#: A unit at this distance from zero is saturated: tanh(20) is 1 in float32. One-hot inputs times
#: this value switch units on, which lets a plain MLP express a reward with one output per action.
SATURATED = 20.0
#: Minimum rotation of x per step, and minimum distance from half a turn. Each plane has its own
#: part of the range in between.
MIN_ANGLE = math.radians(20)


_Tensors = dict[str, Genotype]


@dataclass(frozen=True)
class ExogenousFamily:
    """See the module."""

    architecture: Architecture
    scale: ObservationScale
    #: Above 1, an episode leaves the narrow region in which the task's own episodes start.
    spread: float

    @classmethod
    def build(
        cls, architecture: Architecture, scale: ObservationScale, hp: SEHyperparameters
    ) -> Self:
        """Return the family, with at least two units for each observation (done) and action
        (reward). Raises InvalidInput for networks that cannot hold it."""
        if architecture.continuous:
            raise InvalidInput("se.family 'exogenous' needs discrete actions")
        if (architecture.hidden_layers, architecture.activation) != (1, "tanh"):
            raise InvalidInput("se.family 'exogenous' needs se.hidden_layers 1, se.activation tanh")
        smallest = 2 * max(architecture.state_size, architecture.action_size)
        hidden_size = max(architecture.hidden_size, smallest)
        return cls(replace(architecture, hidden_size=hidden_size), scale, hp.spread)

    @cached_property
    def _shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the parts of a genotype, in order."""
        states, action_size = self.architecture.state_size, self.architecture.action_size
        units = self.architecture.hidden_size
        bends = units // action_size - 2  # K: two units for an action's linear part and constants
        return {
            "W": (units, states),
            "b": (units,),
            "B": (states, states),
            "phi": (states // 2,),
            "v": (states,),
            "L": (action_size, states),
            "R": (bends, states),
            "d": (bends,),
            "U": (action_size, bends),
            "e": (states,),
        }

    @property
    def size(self) -> int:
        """D."""
        return sum(math.prod(shape) for shape in self._shapes.values())

    def parts(self, genotype: Genotype) -> _Tensors:
        """Return views of a genotype (D,) by name."""
        ends = np.cumsum([math.prod(shape) for shape in self._shapes.values()])
        pairs = zip(self._shapes.items(), np.split(genotype, ends[:-1]), strict=True)
        return {name: part.reshape(shape) for (name, shape), part in pairs}

    def initialize(self, rng: np.random.Generator) -> Genotype:
        """Draw standard normal genes, INERTIA times larger for the next state; biases are zero."""
        genotype = rng.standard_normal(self.size, np.float32)
        parts = self.parts(genotype)
        for name in ("W", "B", "phi"):
            parts[name][...] *= INERTIA
        for name in ("b", "v", "d", "e"):
            parts[name][...] = 0
        return genotype

    def psi(self, genotype: Genotype) -> Psi:
        """Write a genotype (D,) into three plain MLPs."""
        psi = np.zeros(self.architecture.parameter_count, np.float32)
        tensors, parts = self.architecture.tensors(psi), self.parts(genotype)
        self._write_next_state(tensors, parts)
        self._write_reward(tensors, parts)
        self._write_done(tensors, parts)
        return psi

    def _read_states(
        self, tensors: _Tensors, net: str, rows: slice, weights: Genotype, bias: Genotype | float
    ) -> None:
        """Let these units of a network compute weights @ x + bias of the scaled state x."""
        raw = weights / self.scale.deviation
        tensors[f"{net}.0.weight"][rows, self.architecture.action_size :] = raw
        tensors[f"{net}.0.bias"][rows] = bias - raw @ self.scale.mean

    def _write_next_state(self, tensors: _Tensors, parts: _Tensors) -> None:
        """Map x to about spread Q x near the mean observation."""
        weights = parts["W"].astype(np.float64) / (RANGE * INERTIA * math.sqrt(parts["v"].size))
        out = self.spread * _rotation(parts["B"], parts["phi"] / INERTIA) @ np.linalg.pinv(weights)
        units = slice(len(weights))
        biases, deviation = BIAS / INERTIA * parts["b"], self.scale.deviation
        self._read_states(tensors, "next_state", units, weights.astype(np.float32), biases)
        tensors["next_state.1.weight"][...] = out * deviation[:, None]
        tensors["next_state.1.bias"][...] = (
            self.scale.mean + BIAS / INERTIA * parts["v"] * deviation
        )

    def _write_reward(self, tensors: _Tensors, parts: _Tensors) -> None:
        """Use one block of units per action, which its one-hot input switches on.

        The first unit of a block is nearly linear. A unit that is off outputs -1.
        """
        bends, states = parts["R"].shape
        linear = parts["L"] - parts["L"].mean(axis=0)
        linear *= np.float32(LINEAR / math.sqrt(states))
        weights = parts["R"] * np.float32(STEEPNESS / math.sqrt(states))
        biases = BIAS * parts["d"]
        preference = parts["U"] - parts["U"].mean(axis=0)
        preference *= np.float32(BEND / math.sqrt(max(bends, 1)))
        at_mean = preference @ np.tanh(biases)  # (A,)
        total = preference.sum()
        action_size, units = len(preference), bends + 1
        switches, output = tensors["reward.0.weight"], tensors["reward.1.weight"][0]
        for action in range(action_size):
            line = action * units
            block, bent = slice(line, line + units), slice(line + 1, line + units)
            first, slope = slice(line, line + 1), NEARLY * linear[[action]]
            self._read_states(tensors, "reward", first, slope, -SATURATED)
            self._read_states(tensors, "reward", bent, weights, biases - SATURATED)
            switches[block, action] = SATURATED
            output[line] = 1 / NEARLY
            output[bent] = preference[action]
            # Cancels the output of the blocks that are off, and the reward at the mean.
            unit = action_size * units + action
            switches[unit, action] = SATURATED
            others = total - preference[action].sum() + (action_size - 1) / NEARLY
            output[unit] = others - at_mean[action]

    def _write_done(self, tensors: _Tensors, parts: _Tensors) -> None:
        """Use two units per component of x, one for each side of the box.

        Each contributes 0 inside the box, 1/2 at its side and 1 outside.
        """
        edges = np.float32(EDGE) * np.exp(BIAS / INERTIA * parts["e"])
        sides = np.array([[SIDES], [-SIDES]], np.float32)
        steep = np.kron(np.eye(edges.size, dtype=np.float32), sides)  # (2 S, S)
        units = slice(len(steep))
        biases = (-SIDES * np.repeat(edges, 2)).astype(np.float32)
        self._read_states(tensors, "done", units, steep, biases)
        tensors["done.1.weight"][0, units] = 0.5
        tensors["done.1.bias"][...] = 0.5 * 2 * edges.size


def _rotation(basis: Genotype, angles: Genotype) -> NDArray[np.float64]:
    """Return Q (S, S) from the genes of its planes (S, S) and of its angles (S // 2,)."""
    size, planes = len(basis), len(angles)
    left, _, right = np.linalg.svd(basis.astype(np.float64))
    orthogonal = left @ right  # the nearest orthogonal matrix
    share = (np.arange(planes) + 0.5 + 0.5 * np.tanh(angles.astype(np.float64))) / planes
    turned = -np.eye(size)
    for plane, angle in enumerate(MIN_ANGLE + share * (math.pi - 2 * MIN_ANGLE)):
        cosine, sine = math.cos(angle), math.sin(angle)
        both = slice(2 * plane, 2 * plane + 2)
        turned[both, both] = [[cosine, -sine], [sine, cosine]]
    rotation: NDArray[np.float64] = orthogonal.T @ turned @ orthogonal
    return rotation
