"""The hyperparameters of the agents: what all share, and those of the built-in ones.

A class names its agent when it is defined, and is found under that name.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from bilevel.activations import CODES
from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters.validation import Validated, choice, ranged
from bilevel.networks import Network, network

ACTIVATIONS = tuple(CODES)

_BY_NAME: dict[str, type["AgentHyperparameters"]] = {}


@dataclass(frozen=True, kw_only=True)
class AgentHyperparameters(Validated):
    """What every agent has: how long it trains, and is tested.

    A subclass gives its agent's name, `class MyHyperparameters(AgentHyperparameters,
    agent="mine")`, and adds the agent's own fields with `ranged` and `choice`.
    """

    agent: ClassVar[str] = ""

    init_episodes: int = ranged(0, 1_000_000, 10)  # episodes before the first gradient step
    max_episodes: int = ranged(1, 1_000_000, 1000)  # n_e
    early_out_episodes: int = ranged(1, 1_000_000, 10)  # d
    early_out_difference: float = ranged(0.0, 1e6, 0.01)  # C_diff
    test_episodes: int = ranged(1, 1_000_000, 10)  # n_te

    def __init_subclass__(cls, agent: str = "", **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if agent:
            cls.agent = agent
            _BY_NAME[agent] = cls

    @property
    def step_cost(self) -> float:
        """About what a gradient step costs, to tell long evaluations from short ones
        before they are run; in multiplications. An agent that does not say is taken for
        a large one, as it has no kernel."""
        return 1e9


def agent_names() -> tuple[str, ...]:
    """Agents whose hyperparameters are known."""
    return tuple(_BY_NAME)


def agent_hyperparameters(agent: str) -> type[AgentHyperparameters]:
    """The class of an agent's hyperparameters. Raises InvalidInput for another name."""
    if agent not in _BY_NAME:
        raise one_of("agent", agent, agent_names())
    return _BY_NAME[agent]


@dataclass(frozen=True, kw_only=True)
class _OffPolicy(AgentHyperparameters):
    """What the three agents of the paper share (Table "Default HPs")."""

    batch_size: int = ranged(1, 65536)
    learning_rate: float = ranged(1e-8, 1.0)  # of Adam
    target_update_rate: float = ranged(0.0, 1.0)  # of the soft update
    discount: float = ranged(0.0, 1.0)
    hidden_layers: int = ranged(1, 3)
    hidden_size: int = ranged(1, 4096)
    activation: str = choice(ACTIVATIONS)
    replay_capacity: int = ranged(1, 100_000_000, 100_000)

    @property
    def step_cost(self) -> float:
        """A minibatch's pass through the network, its first and last layer counted as
        narrow."""
        between = self.hidden_size * (self.hidden_layers - 1)
        return float(self.batch_size * self.hidden_size * (between + 8))


@dataclass(frozen=True, kw_only=True)
class DDQNHyperparameters(_OffPolicy, agent="ddqn"):
    """Double DQN (van Hasselt et al., 2016), as the inner loop trains it."""

    dueling: ClassVar[bool] = False

    initial_epsilon: float = ranged(0.0, 1.0)  # in the first episode
    minimal_epsilon: float = ranged(0.0, 1.0)
    epsilon_decay: float = ranged(0.0, 1.0)  # factor per episode

    def network(self, state_size: int, n_actions: int) -> Network:
        """The shape of the Q-network."""
        return network(state_size, self.hidden_size, self.hidden_layers, n_actions, self.activation)


@dataclass(frozen=True, kw_only=True)
class DuelingDDQNHyperparameters(DDQNHyperparameters, agent="dueling-ddqn"):
    """Dueling Double DQN (Wang et al., 2016): DDQN with another network."""

    dueling: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hidden_size < 2:
            raise InvalidInput(
                "DuelingDDQN hidden_size must be at least 2, one unit a stream; "
                f"got {self.hidden_size}"
            )

    def network(self, state_size: int, n_actions: int) -> Network:
        """The shape of the Q-network: one hidden layer more, half of whose units belong to the
        value, the other half to the advantages."""
        of_value = (self.hidden_size + 1) // 2
        return network(
            state_size,
            self.hidden_size,
            self.hidden_layers + 1,
            1 + n_actions,
            self.activation,
            heads=((of_value, 1), (self.hidden_size - of_value, n_actions)),
        )


@dataclass(frozen=True, kw_only=True)
class TD3Hyperparameters(_OffPolicy, agent="td3"):
    """TD3 (Fujimoto et al., 2018) with Gumbel-Softmax actions (Jang et al., 2017).

    The paper's table gives the start temperature alone; noise and delay are TD3's
    usual ones, which its authors' code has too.
    """

    #: Temperatures stay within: below, gradients vanish; above, actions are all alike.
    temperatures: ClassVar[tuple[float, float]] = (0.1, 10.0)

    policy_delay: int = ranged(1, 1000, 2)  # critic steps a step of actor and targets
    action_noise: float = ranged(0.0, 10.0, 0.1)  # std. dev. added to relaxed actions
    target_noise: float = ranged(0.0, 10.0, 0.2)  # std. dev. of target smoothing
    target_noise_clip: float = ranged(0.0, 10.0, 0.5)
    initial_temperature: float = ranged(0.1, 10.0, 1.0)  # of the Gumbel-Softmax, learned

    @property
    def step_cost(self) -> float:
        """Of the two critics."""
        return 2 * super().step_cost

    def networks(self, state_size: int, n_actions: int) -> tuple[Network, Network]:
        """The shapes of actor and critic."""
        actor, critic = (
            network(inputs, self.hidden_size, self.hidden_layers, outputs, self.activation)
            for inputs, outputs in ((state_size, n_actions), (state_size + n_actions, 1))
        )
        return actor, critic
