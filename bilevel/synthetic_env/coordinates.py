"""The coordinates in which NES moves: a vector theta (D,), and the psi (P,) that it stands for.

Whatever the coordinates, an SE is three plain MLPs: `psi` writes theta into them.

plain       theta is psi, initialised uniformly in +-1/sqrt(fan_in) (the paper's)
exogenous   the next state does not depend on the action, and rewards compare actions

*Exogenous* SEs start from two observations about random ones (docs/nes.md). The reward of a
plain one prefers the same action nearly everywhere, and its states stay close to one point, so
its agents learn nothing and all scores are noise. Here

    x   = (s - m) / c                                     m, c: mean and scale of observations
    s'  = m + c * (f Q W^+ tanh(W x + b) + v)             the same whatever the action
    G   = U tanh(R x + d)                                 A_a = G_a - mean of G over actions
    r(s, a) = A_a(x) - A_a(0)
    done  rises above its threshold where a component of x leaves +-E

Rewards whose mean over actions is zero in all states say which action is better and nothing else,
and no action is preferred at the mean observation. An agent that has learned nothing yet, and one
that keeps to one action, then earn about nothing: between such returns relative differences are
large, so that the stopping rule ends training only once there is something to lose. States that
follow their own course make the action of the highest reward optimal for every discount, so that an
agent that looks one step ahead and one that looks a hundred agree on what is to be learned; Liesen
et al. (2024, "Discovering Minimal Reinforcement Learning Environments") found that SEs which are
free to do so become such contextual bandits by themselves. Episodes that end where the usual
observations do keep returns, and so the errors of bootstrapped values, small. m and c are those of
a few episodes of random actions.

symbol     shape        meaning
--------   ----------   --------------------------------------------------------------
theta      (D,)         all coordinates: normal in a random SE, biases zero
W, W^+     (H, S), (S, H)   of the next state; W^+ is the pseudoinverse of W
Q          (S, S)       the orthogonal matrix nearest to a matrix of coordinates
R, U       (K, S), (A, K)   of the reward, K = (H - A) // A
E          (S,)         half-widths of the box in which an episode goes on
f                       `se.spread`
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from bilevel.errors import InvalidInput
from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env.architecture import SE, Architecture, Psi
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


def coordinates(task: Task, hp: SEHyperparameters, scale: ObservationScale) -> Coordinates:
    """The coordinates that `hp.structure` names; only exogenous ones read `scale`.

    Raises InvalidInput for networks that cannot hold the structure.
    """
    architecture = Architecture.of(task, hp)
    if hp.structure == "plain":
        return PlainCoordinates(architecture)
    if (hp.hidden_layers, hp.activation) != (1, "tanh"):
        raise InvalidInput(
            "SE structure 'exogenous' needs hidden_layers 1 and activation tanh; got "
            f"{hp.hidden_layers} and {hp.activation}"
        )
    least = 2 * max(task.n_actions, task.state_size)
    if hp.hidden_size < least:
        raise InvalidInput(
            f"SE structure 'exogenous' needs a hidden_size of at least {least}, two units an "
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
#: Of the reward's units: below 2 they are nearly linear over the observations' scale, which is
#: what most agents interpolate well. And of the reward itself.
STEEPNESS, REWARD = 1.5, 3.0
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


@dataclass(frozen=True)
class ExogenousCoordinates:
    """See the module."""

    architecture: Architecture
    scale: ObservationScale
    #: Above 1, an episode leaves the narrow region in which the task's own episodes start. Further
    #: out tanh holds it back; some episodes leave the box, others go on until the step limit.
    spread: float

    @property
    def _reward_units(self) -> int:
        n_actions = self.architecture.n_actions
        return (self.architecture.hidden_size - n_actions) // n_actions

    @cached_property
    def _shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the parts of theta, in their order."""
        arch = self.architecture
        states, n_actions, units = arch.state_size, arch.n_actions, arch.hidden_size
        rewarding = self._reward_units
        return {
            "W": (units, states),
            "b": (units,),
            "Q": (states, states),
            "v": (states,),
            "R": (rewarding, states),
            "d": (rewarding,),
            "U": (n_actions, rewarding),
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
        for name in ("W", "Q"):
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
        out = self.spread * _nearest_orthogonal(parts["Q"]) @ np.linalg.pinv(weights)
        units = slice(len(weights))
        self._read_states(layers, units, weights.astype(np.float32), BIAS / INERTIA * parts["b"])
        deviation = self.scale.deviation
        layers.output_weights[...] = out * deviation[:, None]
        layers.output_biases[...] = self.scale.mean + BIAS / INERTIA * parts["v"] * deviation

    def _write_reward(self, layers: "_Layers", parts: dict[str, Theta]) -> None:
        """One block of units an action, switched on by its one-hot input; off, a unit is -1."""
        rewarding, states = parts["R"].shape
        weights = parts["R"] * np.float32(STEEPNESS / math.sqrt(states))
        biases = BIAS * parts["d"]
        preference = parts["U"] - parts["U"].mean(axis=0)
        preference *= np.float32(REWARD / math.sqrt(rewarding))
        at_mean = preference @ np.tanh(biases)  # (A,)
        total = preference.sum()
        n_actions = len(preference)
        for action in range(n_actions):
            block = slice(action * rewarding, (action + 1) * rewarding)
            self._read_states(layers, block, weights, biases - SATURATED)
            layers.weights[block, action] = SATURATED
            layers.output_weights[0, block] = preference[action]
            # What the other blocks add while they are off, and the reward at the mean.
            unit = n_actions * rewarding + action
            layers.weights[unit, action] = SATURATED
            layers.output_weights[0, unit] = total - preference[action].sum() - at_mean[action]

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


def _nearest_orthogonal(matrix: Theta) -> NDArray[np.float64]:
    """The orthogonal matrix (S, S) that is nearest to this one: a rotation, or a reflection."""
    left, _, right = np.linalg.svd(matrix.astype(np.float64))
    nearest: NDArray[np.float64] = left @ right
    return nearest


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


@dataclass(frozen=True)
class SEDistribution:
    """N(mean, diag(std_dev^2)) over SEs: what NES moves, and what its members are drawn from.

    `average` is a moving average of past means, or the mean itself: the steps of NES are noisy, and
    what they have in common is better than any one of them (Polyak and Juditsky, 1992).
    """

    coordinates: Coordinates
    mean: Theta  # (D,)
    std_dev: Theta  # (D,)
    average: Theta  # (D,)

    @property
    def centre(self) -> SE:
        """The unperturbed SE, at the average."""
        return self.at(self.average)

    def moved(self, step: Theta, averaging: float) -> Self:
        """With `step` (D,) added to the mean, and the old average, times `averaging`, kept."""
        mean = self.mean + step
        kept = np.float32(averaging)
        return replace(self, mean=mean, average=kept * self.average + (1 - kept) * mean)

    def placed(self, theta: Theta) -> Self:
        """With the mean at theta (D,), and nothing to average yet."""
        return replace(self, mean=theta, average=theta)

    def at(self, theta: Theta) -> SE:
        """The SE at theta (D,)."""
        return SE(self.coordinates.architecture, self.coordinates.psi(theta))

    def noise(self, seed: int) -> Theta:
        """Standard normal z (D,), the same for the same seed everywhere."""
        return np.random.default_rng(seed).standard_normal(self.mean.size, np.float32)

    def perturbed(self, seed: int, sign: int) -> SE:
        """The SE at mean + sign * std_dev * z; eps of the paper is std_dev * z."""
        return self.at(self.mean + np.float32(sign) * self.std_dev * self.noise(seed))

    def random(self, seed: int) -> SE:
        """A random initialisation."""
        return self.at(self.coordinates.initialize(np.random.default_rng(seed)))
