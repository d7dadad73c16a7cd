"""What an SE is beside its parameters, and these as one flat vector psi.

Three MLPs of one shape (next state, reward, done) read the same input,
concat(one_hot(action), state). psi is their weights and biases one after the
other, each network laid out as torch lays it (`bilevel.kernels.mlp`).

symbol   meaning
------   ---------------------------------------
S, A     state size, number of actions
P        length of psi
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import SEHyperparameters
from bilevel.kernels.activations import LRELU_SLOPE, PRELU_INITIAL_SLOPE
from bilevel.kernels.mlp import Network, initial_parameters, network
from bilevel.kernels.synthetic_env import SEKernel, prepare
from bilevel.tasks import Task

#: The networks of an SE in the order in which psi holds them.
NETWORKS = ("next_state", "reward", "done")

#: The slope for negative inputs. NES perturbs weights and biases alone, so a
#: PReLU keeps the slope it starts with.
_SLOPES = {"tanh": 0.0, "relu": 0.0, "lrelu": LRELU_SLOPE, "prelu": PRELU_INITIAL_SLOPE}


@dataclass(frozen=True)
class Architecture:
    """Sizes of an SE's networks, and how long its episodes may be.

    `reward_scale` multiplies the reward network's last layer in a fresh psi and in
    perturbations; a given psi it does not change. `step_limit_share` is that of the real
    task's step limit.
    """

    state_size: int
    n_actions: int
    hidden_layers: int
    hidden_size: int
    activation: str
    reward_scale: float = 1.0
    step_limit_share: float = 1.0

    @classmethod
    def of(cls, task: Task, hp: SEHyperparameters) -> "Architecture":
        """The architecture of an SE for `task`."""
        return cls(
            task.state_size,
            task.n_actions,
            hp.hidden_layers,
            hp.hidden_size,
            hp.activation,
            hp.reward_scale,
            hp.step_limit_share,
        )

    def step_limit(self, task: Task) -> int:
        """Steps after which an episode on the SE ends if it has not before."""
        return max(1, round(self.step_limit_share * task.step_limit))

    @property
    def slope(self) -> float:
        """Slope of the activation for negative inputs (Tanh has none)."""
        return _SLOPES[self.activation]

    @property
    def networks(self) -> tuple[Network, Network, Network]:
        """Next-state, reward and done network."""
        # A fixed slope is no parameter: to the kernels a PReLU is a leaky ReLU.
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

    def split(
        self, psi: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Views of psi (P,), one a network."""
        counts = [net.parameter_count for net in self.networks]
        next_state, reward, done = np.split(psi, np.cumsum(counts)[:-1])
        return next_state, reward, done

    def initialize(self, rng: np.random.Generator) -> NDArray[np.float32]:
        """A fresh psi (P,): uniform in +-1/sqrt(fan_in), the reward's last layer scaled."""
        psi = np.concatenate([initial_parameters(net, rng) for net in self.networks])
        return self._scale_rewards(psi)

    def perturbation(self, seed: int, std_dev: float) -> NDArray[np.float32]:
        """eps ~ N(0, std_dev^2 I), shape (P,), the reward's last layer scaled; the same for
        the same seed everywhere."""
        eps = np.random.default_rng(seed).standard_normal(self.parameter_count, np.float32)
        return self._scale_rewards(eps * np.float32(std_dev))

    def _scale_rewards(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """`values` (P,), changed in place."""
        reward = self.networks[1]
        last = self.split(values)[1][int(reward.offsets[-2]) :]
        last *= np.float32(self.reward_scale)
        return values


def kernel_form(architecture: Architecture, psi: NDArray[np.float32]) -> SEKernel:
    """psi (P,) arranged for the compiled step."""
    return prepare(
        architecture.networks,
        architecture.split(np.ascontiguousarray(psi, np.float32)),
        architecture.n_actions,
        architecture.slope,
    )
