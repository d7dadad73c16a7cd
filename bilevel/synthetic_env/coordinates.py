"""The coordinates in which NES moves: a vector theta (D,), and the psi (P,) that it stands for.

Whatever the coordinates, an SE is three plain MLPs: `psi` writes theta into them.

plain       theta is psi, initialised uniformly in +-1/sqrt(fan_in) (the paper's)
exogenous   the next state does not depend on the action, and rewards compare actions

*Exogenous* SEs start from two observations about random ones (docs/nes.md). The reward of a
plain one prefers the same action nearly everywhere, and its states stay close to one point, so
its agents learn nothing and all scores are noise. Here

    x   = (s - m) / c                                     m, c: mean and scale of observations
    s'  = m + c * (f Q W^+ tanh(W x + b) + v)             the same whatever the action
    Q   = B' R(phi) B                                     turns x by the angles phi
    G   = L x + U tanh(R x + d)                           A_a = G_a - mean of G over actions
    r(s, a) = A_a(x) - A_a(0)
    done  rises above its threshold where a component of x leaves +-E

Rewards whose mean over actions is zero in all states say which action is better and nothing else,
and no action is preferred at the mean observation. An agent that has learned nothing yet, and one
that keeps to one action, then earn about nothing: between such returns relative differences are
large, so that the stopping rule ends training only once there is something to lose.

States that follow their own course make the action of the highest reward optimal for every
discount, so that an agent that looks one step ahead and one that looks a hundred agree on what is
to be learned; Liesen et al. (2024, "Discovering Minimal Reinforcement Learning Environments") found
that SEs which are free to do so become such contextual bandits by themselves.

Q turns x in S // 2 planes, in each by an angle of its own, and none of them small; where S is odd,
what is left changes its sign. Where Q is any orthogonal matrix, half of them reflect, and a
component of x that keeps its sign for a whole episode shows the agent one side of the reward alone.
Episodes that end where the usual observations do keep returns, and so the errors of bootstrapped
values, small. m and c are those of many steps of random actions (`Task.observation_scale`).

symbol     shape        meaning
--------   ----------   --------------------------------------------------------------
theta      (D,)         all coordinates: normal in a random SE, biases zero
W, W^+     (H, S), (S, H)   of the next state; W^+ is the pseudoinverse of W
B          (S, S)       the orthogonal matrix nearest to one of coordinates: the planes of Q
phi        (S // 2,)    angles of Q, from LEAST_ANGLE to pi - LEAST_ANGLE
L          (A, S)           of the reward's linear part
R, U       (K, S), (A, K)   of what bends it, K = H // A - 2
E          (S,)         half-widths of the box in which an episode goes on
f                       `se.spread`
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env.architecture import Architecture, Psi
from bilevel.tasks import ObservationScale, Task

Theta = NDArray[np.float32]


class Coordinates(Protocol):
    """A way to write a vector theta (D,) into the networks of an SE."""

    @property
    def architecture(self) -> Architecture:
        """Architecture of the SEs."""

    @property
    def size(self) -> int:
        """Length D of theta."""

    def initialize(self, rng: np.random.Generator) -> Theta:
        """theta (D,) of a random SE."""

    def psi(self, theta: Theta) -> Psi:
        """The parameters (P,) of the SE at theta (D,)."""


def least_units(task: Task) -> int:
    """Fewest units of an exogenous SE for the task: two an action and an observation."""
    return 2 * max(task.n_actions, task.state_size)


def coordinates(task: Task, hp: SEHyperparameters, scale: ObservationScale) -> Coordinates:
    """The coordinates that `hp.structure` names; only exogenous ones read `scale`.

    Raises InvalidInput for networks that cannot hold the structure.
    """
    architecture = Architecture.of(task, hp)
    if hp.structure == "plain":
        return PlainCoordinates(architecture)
    if (hp.hidden_layers, hp.activation) != (1, "tanh"):
        raise InvalidInput(
            "se.structure 'exogenous' needs se.hidden_layers 1 and se.activation tanh; got "
            f"{hp.hidden_layers} and {hp.activation}"
        )
    least = least_units(task)
    if hp.hidden_size < least:
        raise InvalidInput(
            f"se.structure 'exogenous' needs an se.hidden_size of at least {least}, two units an "
            f"action and an observation of {task.id}; got {hp.hidden_size}"
        )
    return ExogenousCoordinates(architecture, scale, hp.spread)


@dataclass(frozen=True)
class PlainCoordinates:
    """theta is psi."""

    architecture: Architecture

    @property
    def size(self) -> int:
        """P."""
        return self.architecture.parameter_count

    def initialize(self, rng: np.random.Generator) -> Theta:
        """Uniform in +-1/sqrt(fan_in)."""
        return self.architecture.initialize(rng)

    def psi(self, theta: Theta) -> Psi:
        """theta itself."""
        return theta


#: Size of the components of x at which tanh begins to saturate.
RANGE = 3.0
#: Half-width of the box in a random SE, in units of c, and how steeply done rises at its sides.
EDGE, SIDES = 2.0, 2.0
#: Of the reward: its linear part, and what bends it, whose units are steep by STEEPNESS. The linear
#: part is the larger one and has few coordinates, so that NES finds it soon and accurately; and
#: rewards that are nearly linear are what agents interpolate well.
LINEAR, BEND, STEEPNESS = 1.0, 0.5, 1.5
#: A unit whose input is so many times as small as what it stands for is nearly linear.
NEARLY = 0.02
#: Scale of biases.
BIAS = 0.3
#: Coordinates of the next state and of the box are so many times as large as the others, so that
#: perturbations change them as many times less: what an episode is like stays, what it rewards
#: is learned. Where both move alike, runs drift to episodes of a few steps, after which agents
#: that learn slowly stop too early.
INERTIA = 4.0
#: A unit at this distance from zero is saturated: tanh(20) is 1 in float32. One-hot inputs times
#: it switch units on, and so express in a plain MLP a reward with one output an action.
SATURATED = 20.0
#: A step turns x by this angle at least, and by as much less than half a turn. Each plane has its
#: part of the range between, so that no two planes turn alike.
LEAST_ANGLE = math.radians(20)


@dataclass(frozen=True)
class ExogenousCoordinates:
    """See the module."""

    architecture: Architecture
    scale: ObservationScale
    #: Above 1, an episode leaves the narrow region in which the task's own episodes start. Further
    #: out tanh holds it back; some episodes leave the box, others go on until the step limit.
    spread: float

    @property
    def _bends(self) -> int:
        """K: beside them, each action has a unit for its linear part and one for its constants."""
        return self.architecture.hidden_size // self.architecture.n_actions - 2

    @cached_property
    def _shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the parts of theta, in their order."""
        arch = self.architecture
        states, n_actions, units = arch.state_size, arch.n_actions, arch.hidden_size
        bends = self._bends
        return {
            "W": (units, states),
            "b": (units,),
            "B": (states, states),
            "phi": (states // 2,),
            "v": (states,),
            "L": (n_actions, states),
            "R": (bends, states),
            "d": (bends,),
            "U": (n_actions, bends),
            "e": (states,),
        }

    @property
    def size(self) -> int:
        """D."""
        return sum(math.prod(shape) for shape in self._shapes.values())

    def parts(self, theta: Theta) -> dict[str, Theta]:
        """Views of theta (D,) by name."""
        views, start = {}, 0
        for name, shape in self._shapes.items():
            end = start + math.prod(shape)
            views[name] = theta[start:end].reshape(shape)
            start = end
        return views

    def initialize(self, rng: np.random.Generator) -> Theta:
        """Standard normal, INERTIA times as large for the next state; biases zero."""
        theta = rng.standard_normal(self.size, np.float32)
        parts = self.parts(theta)
        for name in ("W", "B", "phi"):
            parts[name][...] *= INERTIA
        for name in ("b", "v", "d", "e"):
            parts[name][...] = 0
        return theta

    def psi(self, theta: Theta) -> Psi:
        """The three plain MLPs at theta (D,)."""
        psi = np.zeros(self.architecture.parameter_count, np.float32)
        parts = self.parts(theta)
        next_state, reward, done = (
            _Layers.of(self.architecture, part, outputs)
            for part, outputs in zip(
                self.architecture.split(psi), (self.architecture.state_size, 1, 1), strict=True
            )
        )
        self._write_next_state(next_state, parts)
        self._write_reward(reward, parts)
        self._write_done(done, parts)
        return psi

    def _read_states(
        self, layers: "_Layers", rows: slice, weights: Theta, bias: Theta | float
    ) -> None:
        """Let these units compute weights @ x + bias, x being the scaled state."""
        n_actions = self.architecture.n_actions
        raw = weights / self.scale.deviation
        layers.weights[rows, n_actions:] = raw
        layers.biases[rows] = bias - raw @ self.scale.mean

    def _write_next_state(self, layers: "_Layers", parts: dict[str, Theta]) -> None:
        """Near the mean observation, x -> spread Q x."""
        weights = parts["W"].astype(np.float64) / (RANGE * INERTIA * math.sqrt(parts["v"].size))
        out = self.spread * _rotation(parts["B"], parts["phi"] / INERTIA) @ np.linalg.pinv(weights)
        units = slice(len(weights))
        self._read_states(layers, units, weights.astype(np.float32), BIAS / INERTIA * parts["b"])
        deviation = self.scale.deviation
        layers.output_weights[...] = out * deviation[:, None]
        layers.output_biases[...] = self.scale.mean + BIAS / INERTIA * parts["v"] * deviation

    def _write_reward(self, layers: "_Layers", parts: dict[str, Theta]) -> None:
        """One block of units an action, the first of them nearly linear, switched on by its one-hot
        input; off, a unit is -1."""
        bends, states = parts["R"].shape
        linear = parts["L"] - parts["L"].mean(axis=0)
        linear *= np.float32(LINEAR / math.sqrt(states))
        weights = parts["R"] * np.float32(STEEPNESS / math.sqrt(states))
        biases = BIAS * parts["d"]
        preference = parts["U"] - parts["U"].mean(axis=0)
        preference *= np.float32(BEND / math.sqrt(max(bends, 1)))
        at_mean = preference @ np.tanh(biases)  # (A,)
        total = preference.sum()
        n_actions, units = len(preference), bends + 1
        for action in range(n_actions):
            line = action * units
            block, bent = slice(line, line + units), slice(line + 1, line + units)
            self._read_states(layers, slice(line, line + 1), NEARLY * linear[[action]], -SATURATED)
            self._read_states(layers, bent, weights, biases - SATURATED)
            layers.weights[block, action] = SATURATED
            layers.output_weights[0, line] = 1 / NEARLY
            layers.output_weights[0, bent] = preference[action]
            # What the other blocks add while they are off, and the reward at the mean.
            unit = n_actions * units + action
            layers.weights[unit, action] = SATURATED
            others = total - preference[action].sum() + (n_actions - 1) / NEARLY
            layers.output_weights[0, unit] = others - at_mean[action]

    def _write_done(self, layers: "_Layers", parts: dict[str, Theta]) -> None:
        """Two units a component of x, one for each side of the box; 0 inside, 1 at the side, 2
        beyond, all of which times 1/2 is the done output."""
        edges = np.float32(EDGE) * np.exp(BIAS / INERTIA * parts["e"])
        for component, edge in enumerate(edges):
            steep = np.zeros((1, edges.size), np.float32)
            steep[0, component] = SIDES
            for side, sign in enumerate((np.float32(1), np.float32(-1))):
                unit = 2 * component + side
                self._read_states(layers, slice(unit, unit + 1), sign * steep, -SIDES * edge)
                layers.output_weights[0, unit] = 0.5
        layers.output_biases[...] = 0.5 * 2 * edges.size


def _rotation(basis: Theta, coordinates: Theta) -> NDArray[np.float64]:
    """Q (S, S), which turns the planes that `basis` (S, S) stands for by the angles that
    `coordinates` (S // 2,) stand for; the last component of an odd S changes its sign."""
    size, planes = len(basis), len(coordinates)
    left, _, right = np.linalg.svd(basis.astype(np.float64))
    orthogonal = left @ right  # the nearest orthogonal matrix
    share = (np.arange(planes) + 0.5 + 0.5 * np.tanh(coordinates.astype(np.float64))) / planes
    turned = -np.eye(size)
    for plane, angle in enumerate(LEAST_ANGLE + share * (math.pi - 2 * LEAST_ANGLE)):
        cosine, sine = math.cos(angle), math.sin(angle)
        both = slice(2 * plane, 2 * plane + 2)
        turned[both, both] = [[cosine, -sine], [sine, cosine]]
    rotation: NDArray[np.float64] = orthogonal.T @ turned @ orthogonal
    return rotation


@dataclass(frozen=True)
class _Layers:
    """Views of a network's parameters; one hidden layer of H units."""

    weights: Theta  # (H, A + S)
    biases: Theta  # (H,)
    output_weights: Theta  # (O, H)
    output_biases: Theta  # (O,)

    @classmethod
    def of(cls, architecture: Architecture, part: Psi, outputs: int) -> "_Layers":
        units = architecture.hidden_size
        inputs = architecture.n_actions + architecture.state_size
        sizes = (units * inputs, units, outputs * units, outputs)
        w, b, v, o = np.split(part, np.cumsum(sizes)[:-1])
        return cls(w.reshape(units, inputs), b, v.reshape(outputs, units), o)
