"""The architecture of an SE, and its parameters as one flat vector psi.

Three MLPs with equal hidden layers (next state, reward, done) read the same input,
concat(one_hot(action), state). psi concatenates their parameters, in the layout of
`bilevel.networks`.

symbol   meaning
------   ---------------------------------------
S, A     state size, number of actions
P        length of psi
"""

import json
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from bilevel.activations import LRELU_SLOPE, PRELU_INITIAL_SLOPE
from bilevel.durable import checksum
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import SEHyperparameters
from bilevel.kernels.synthetic_env import SEKernel, prepare
from bilevel.networks import Network, initial_parameters, network
from bilevel.tasks import Task

#: The networks of an SE, in the order of psi.
NETWORKS = ("next_state", "reward", "done")

#: Slopes for negative inputs. NES changes weights and biases only, so a PReLU keeps its initial
#: slope.
_SLOPES = {"tanh": 0.0, "relu": 0.0, "lrelu": LRELU_SLOPE, "prelu": PRELU_INITIAL_SLOPE}

Psi = NDArray[np.float32]


@dataclass(frozen=True)
class Architecture:
    """Sizes of an SE's networks, and the step limit that truncates its episodes."""

    state_size: int
    n_actions: int
    hidden_layers: int
    hidden_size: int
    activation: str
    step_limit: int

    @classmethod
    def of(cls, task: Task, hp: SEHyperparameters) -> "Architecture":
        """The architecture of an SE for `task`."""
        return cls(
            task.state_size,
            task.n_actions,
            hp.hidden_layers,
            hp.hidden_size,
            hp.activation,
            hp.step_limit or task.step_limit,
        )

    def check_fits(self, task: Task) -> None:
        """Raise InvalidInput if the task has other sizes."""
        if (self.state_size, self.n_actions) != (task.state_size, task.n_actions):
            raise InvalidInput(
                f"the SE has {self.state_size} state dimensions and {self.n_actions} actions: "
                f"{task.id} has {task.state_size} and {task.n_actions}"
            )

    @property
    def slope(self) -> float:
        """Slope of the activation for negative inputs (Tanh has none)."""
        return _SLOPES[self.activation]

    @property
    def networks(self) -> tuple[Network, Network, Network]:
        """Shapes of the next-state, reward and done network."""
        # A fixed slope is no parameter, so the kernels treat a PReLU as a LeakyReLU.
        activation = "lrelu" if self.activation == "prelu" else self.activation
        next_state, reward, done = (
            network(
                self.n_actions + self.state_size,
                self.hidden_size,
                self.hidden_layers,
                outputs,
                activation,
            )
            for outputs in (self.state_size, 1, 1)
        )
        return next_state, reward, done

    @property
    def parameter_count(self) -> int:
        """Length P of psi."""
        return sum(net.parameter_count for net in self.networks)

    def split(self, psi: Psi) -> tuple[Psi, Psi, Psi]:
        """Views of psi (P,), one per network."""
        counts = [net.parameter_count for net in self.networks]
        next_state, reward, done = np.split(psi, np.cumsum(counts)[:-1])
        return next_state, reward, done

    def initialize(self, rng: np.random.Generator) -> Psi:
        """Draw an initial psi (P,), uniform in +-1/sqrt(fan_in)."""
        return np.concatenate([initial_parameters(net, rng) for net in self.networks])


@dataclass(frozen=True, eq=False)
class SE:
    """A synthetic environment: its architecture and its parameters psi (P,). SEs are equal if both
    are.

    Raises InvalidInput for psi of another length.
    """

    architecture: Architecture
    psi: Psi = field(repr=False)

    def __post_init__(self) -> None:
        psi = np.array(self.psi, np.float32)  # a copy: an SE does not change with its source
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

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def finite(self) -> bool:
        """Whether all parameters are finite numbers."""
        return bool(np.isfinite(self.psi).all())

    @property
    def kernel(self) -> SEKernel:
        """The SE arranged for the compiled step."""
        return prepare(
            self.architecture.networks,
            self.architecture.split(self.psi),
            self.architecture.n_actions,
            self.architecture.slope,
        )

    @property
    def digest(self) -> str:
        """A short hash that identifies the SE."""
        facts = json.dumps(asdict(self.architecture)).encode()
        return checksum(facts, self.psi.tobytes())[:16]
