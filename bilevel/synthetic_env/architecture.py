"""A synthetic environment (SE): its architecture, and its parameters as one flat vector psi.

Three MLPs with equal hidden layers (next state, reward, done) read the same input,
concat(action, state). A discrete action is one-hot, a continuous one a vector in [-1, 1]. psi
concatenates their parameters, in the layout of `bilevel.networks`. Own initial states W z + b,
with z ~ N(0, I), add the parameters W (S, S) and b (S,).

S is the state size, A the number of actions or the length of an action vector, P the length of psi.
"""

import json
from dataclasses import asdict, dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bilevel.durable import checksum
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import SEHyperparameters
from bilevel.hyperparameters.agents import Activation
from bilevel.kernels.synthetic_env import SEKernel, prepare
from bilevel.networks import (
    LRELU_SLOPE,
    PRELU_INITIAL_SLOPE,
    Network,
    initial_parameters,
    layer_biases,
    layer_weights,
    network,
)
from bilevel.tasks import MAX_STEP_LIMIT, Task

#: The networks of an SE, in the order of psi.
NETWORKS = ("next_state", "reward", "done")

#: Slopes for negative inputs. A PReLU keeps its initial slope, because NES does not change it.
_SLOPES = {"tanh": 0.0, "relu": 0.0, "lrelu": LRELU_SLOPE, "prelu": PRELU_INITIAL_SLOPE}

Psi = NDArray[np.float32]

StepLimit = Annotated[int, Field(ge=1, le=MAX_STEP_LIMIT)]
_Size = Annotated[int, Field(ge=1, le=65536)]


@dataclass(frozen=True)
class Architecture:
    """Sizes of an SE's networks, and the step limit that truncates its episodes. Reading and
    writing an SE file checks the ranges."""

    state_size: _Size
    action_size: _Size
    hidden_layers: _Size
    hidden_size: _Size
    activation: Activation
    step_limit: StepLimit
    continuous: bool = False  #: whether actions are vectors
    #: Whether episodes start in states of the SE instead of initial states of the real task.
    own_initial_states: bool = False

    @classmethod
    def of(cls, task: Task, hp: SEHyperparameters) -> "Architecture":
        """Return the architecture of a plain SE for `task`."""
        sizes = task.state_size, task.action_size, hp.hidden_layers, hp.hidden_size
        return cls(*sizes, hp.activation, hp.step_limit or task.step_limit, task.continuous)

    def check_fits(self, task: Task) -> None:
        """Raise InvalidInput unless the task has states and actions of the same sizes and kind."""
        own = self.state_size, self.action_size, self.continuous
        other = task.state_size, task.action_size, task.continuous
        if own != other:
            kinds = [
                f"{size} state dimensions and {actions} "
                f"{'action dimensions' if continuous else 'discrete actions'}"
                for size, actions, continuous in (own, other)
            ]
            raise InvalidInput(f"the SE has {kinds[0]}: {task.id} has {kinds[1]}")

    @property
    def one_step(self) -> bool:
        """True if episodes have one step."""
        return self.step_limit == 1

    @property
    def slope(self) -> float:
        """Slope of the activation for negative inputs (Tanh has none)."""
        return _SLOPES[self.activation]

    @property
    def networks(self) -> tuple[Network, Network, Network]:
        """Shapes of the next-state, reward and done network."""
        # The slope of a PReLU is not a parameter of the SE: it becomes a LeakyReLU.
        activation = "lrelu" if self.activation == "prelu" else self.activation
        inputs = self.action_size + self.state_size
        next_state, reward, done = (
            network(inputs, self.hidden_size, self.hidden_layers, outputs, activation)
            for outputs in (self.state_size, 1, 1)
        )
        return next_state, reward, done

    @property
    def parameter_count(self) -> int:
        """Length P of psi."""
        initial = self.state_size * (self.state_size + 1) if self.own_initial_states else 0
        return sum(net.parameter_count for net in self.networks) + initial

    def split(self, psi: Psi) -> tuple[Psi, Psi, Psi]:
        """Return views of psi (P,), one per network."""
        counts = [net.parameter_count for net in self.networks]
        next_state, reward, done, _ = np.split(psi, np.cumsum(counts))
        return next_state, reward, done

    def initial(self, psi: Psi) -> tuple[Psi, Psi]:
        """Return views of W (S, S) and b (S,) of own initial states."""
        size = self.state_size
        weight, bias = np.split(psi[-size * (size + 1) :], [size * size])
        return weight.reshape(size, size), bias

    def tensors(self, psi: Psi) -> dict[str, Psi]:
        """Return views of psi (P,) by name: `reward.0.weight` (units, inputs), `reward.0.bias`."""
        tensors = {}
        for name, net, part in zip(NETWORKS, self.networks, self.split(psi), strict=True):
            for layer in range(len(net.shapes)):
                tensors[f"{name}.{layer}.weight"] = layer_weights(net, part, layer)
                tensors[f"{name}.{layer}.bias"] = layer_biases(net, part, layer)
        if self.own_initial_states:
            tensors["initial_state.0.weight"], tensors["initial_state.0.bias"] = self.initial(psi)
        return tensors

    def initialize(self, rng: np.random.Generator) -> Psi:
        """Draw an initial psi (P,), uniform in +-1/sqrt(fan_in)."""
        psi = np.zeros(self.parameter_count, np.float32)
        networks = [initial_parameters(net, rng) for net in self.networks]
        psi[: sum(map(len, networks))] = np.concatenate(networks)
        return psi


@dataclass(frozen=True, eq=False)
class SE:
    """An SE: an architecture and parameters psi (P,). Raises InvalidInput for another length."""

    architecture: Architecture
    psi: Psi = field(repr=False)

    def __post_init__(self) -> None:
        psi = np.array(self.psi, np.float32)  # copies: callers may change their array
        if psi.shape != (self.architecture.parameter_count,):
            raise InvalidInput(
                f"psi has shape {psi.shape}: the SE's networks have "
                f"{self.architecture.parameter_count} parameters"
            )
        object.__setattr__(self, "psi", psi)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SE):
            return NotImplemented
        return self.architecture == other.architecture and np.array_equal(self.psi, other.psi)

    @property
    def finite(self) -> bool:
        """True if all parameters are finite."""
        return bool(np.isfinite(self.psi).all())

    @property
    def kernel(self) -> SEKernel:
        """Parameters arranged for the compiled step."""
        return prepare(
            self.architecture.networks,
            self.architecture.split(self.psi),
            self.architecture.action_size,
            self.architecture.slope,
        )

    def initial_states(self, rng: np.random.Generator, n: int) -> NDArray[np.float32]:
        """Draw `n` own initial states (n, S)."""
        return self.initial_states_of(
            rng.standard_normal((n, self.architecture.state_size), np.float32)
        )

    def initial_states_of(self, noise: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the own initial states (n, S) of standard normal noise (n, S)."""
        weight, bias = self.architecture.initial(self.psi)
        return noise @ weight.T + bias

    @property
    def digest(self) -> str:
        """Short hash of the architecture and psi."""
        facts = json.dumps(asdict(self.architecture)).encode()
        return checksum(facts, self.psi.tobytes())[:16]
