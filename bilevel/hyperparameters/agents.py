"""The hyperparameters of the agents: what all share, and those of the built-in ones.

A class names its agent when it is defined, and is found under that name.
"""

import re
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.networks import Network, network

#: The names of `bilevel.activations`.
Activation = Literal["tanh", "relu", "lrelu", "prelu"]
ACTIVATIONS: tuple[str, ...] = get_args(Activation)

_Episodes = Annotated[int, Field(ge=1, le=1_000_000)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_Noise = Annotated[float, Field(ge=0.0, le=10.0)]

_BY_NAME: dict[str, type["AgentHyperparameters"]] = {}

#: Names that a recipe can have as those of sections, and those that mean something else there.
_AGENT_NAME = re.compile(r"[A-Za-z0-9_-]+")
_RESERVED = ("nes", "se", "agents", "vary_agent")


@hyperparameters
class AgentHyperparameters:
    """Hyperparameters of every agent: the length of training and of tests.

    A subclass, which is decorated likewise, gives its agent's name, `class
    MyHyperparameters(AgentHyperparameters, agent="mine")`, and adds the agent's own fields.
    """

    agent: ClassVar[str] = ""

    #: Episodes before the first gradient step.
    init_episodes: Annotated[int, Field(ge=0, le=1_000_000)] = 10
    max_episodes: _Episodes = 1000  #: n_e, the episodes of training at most.
    #: d: training stops early if the mean return of the last d episodes differs from that of
    #: the d before by a share of at most C_diff (`early_out_difference`).
    early_out_episodes: _Episodes = 10
    early_out_difference: Annotated[float, Field(ge=0.0, le=1e6)] = 0.01  #: C_diff.
    test_episodes: _Episodes = 10  #: n_te, the episodes of a test on the real task.

    def __init_subclass__(cls, agent: str = "", **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if agent:
            if not _AGENT_NAME.fullmatch(agent) or agent in _RESERVED:
                raise InvalidInput(
                    f"the agent name {agent!r} is not allowed: allowed are letters, digits, '_', "
                    f"'-', but not {', '.join(_RESERVED)}"
                )
            taken = _BY_NAME.get(agent)
            # The same file may be loaded again.
            if taken is not None and _place(taken) != _place(cls):
                raise InvalidInput(
                    f"{'.'.join(_place(cls))}: the agent name {agent!r} is taken by "
                    f"{'.'.join(_place(taken))}"
                )
            cls.agent = agent
            _BY_NAME[agent] = cls

    def require_learning(self, patient_episodes: int = 0) -> None:
        """Raise InvalidInput if training ends before the first gradient step, be it that of patient
        agents, which lasts for so many episodes (0: there are none)."""
        most, named, who = self.max_episodes, f"{self.agent}.max_episodes", "agents"
        if 0 < patient_episodes < most:
            most, named, who = patient_episodes, "nes.patient_episodes", "patient agents"
        if self.init_episodes >= most:
            raise InvalidInput(
                f"{self.agent}.init_episodes must be below {named}, {most}, or {who} never learn; "
                f"got {self.init_episodes}"
            )

    @property
    def step_cost(self) -> float:
        """About what a gradient step costs, to tell long evaluations from short ones before they
        are run, and agents that `narrowed` variation makes cheaper: multiplications of one pass of
        a minibatch through the network. An agent that does not say is taken for one without a
        kernel, whose steps take a millisecond, whatever its sizes; it is never narrowed."""
        return 1e7


def _place(cls: type) -> tuple[str, str]:
    return cls.__module__, cls.__qualname__


def keep_hyperparameters(cls: type[AgentHyperparameters]) -> None:
    """Find this class under its agent's name from now on."""
    _BY_NAME[cls.agent] = cls


def agent_names() -> tuple[str, ...]:
    """Agents whose hyperparameters are known."""
    return tuple(_BY_NAME)


def agent_hyperparameters(agent: str) -> type[AgentHyperparameters]:
    """The class of an agent's hyperparameters. Raises InvalidInput for another name."""
    if agent not in _BY_NAME:
        raise one_of("agent", agent, agent_names())
    return _BY_NAME[agent]


@hyperparameters
class _OffPolicy(AgentHyperparameters):
    """Hyperparameters that the three agents of the paper share (Table "Default HPs")."""

    batch_size: Annotated[int, Field(ge=1, le=65536)]  #: Transitions a gradient step.
    learning_rate: Annotated[float, Field(ge=1e-8, le=1.0)]  #: Of Adam.
    target_update_rate: _Share  #: tau of the targets' soft update.
    discount: _Share  #: gamma.
    hidden_layers: Annotated[int, Field(ge=1, le=3)]  #: Of each network.
    hidden_size: Annotated[int, Field(ge=1, le=4096)]  #: Units a hidden layer.
    activation: Activation  #: Of the hidden layers.
    #: Transitions that the replay memory holds.
    replay_capacity: Annotated[int, Field(ge=1, le=100_000_000)] = 100_000

    @property
    def step_cost(self) -> float:
        """A minibatch's pass through the network."""
        return self._pass_cost(self.hidden_layers)

    def _pass_cost(self, hidden_layers: int) -> float:
        """Multiplications of a minibatch's pass through so many hidden layers; the first and the
        last product are counted as narrow."""
        between = self.hidden_size * (hidden_layers - 1)
        return float(self.batch_size * self.hidden_size * (between + 8))


@hyperparameters
class DDQNHyperparameters(_OffPolicy, agent="ddqn"):
    """Double DQN (van Hasselt et al., 2016), as the inner loop trains it."""

    dueling: ClassVar[bool] = False

    initial_epsilon: _Share  #: Share of random actions in the beginning.
    minimal_epsilon: _Share  #: Share of random actions at least.
    epsilon_decay: _Share  #: Factor of that share per episode.

    def network(self, state_size: int, n_actions: int) -> Network:
        """The shape of the Q-network."""
        return network(state_size, self.hidden_size, self.hidden_layers, n_actions, self.activation)


@hyperparameters
class DuelingDDQNHyperparameters(DDQNHyperparameters, agent="dueling-ddqn"):
    """Dueling Double DQN (Wang et al., 2016): DDQN with another network."""

    dueling: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.hidden_size < 2:
            raise InvalidInput(
                "dueling-ddqn.hidden_size must be at least 2, one unit a stream; "
                f"got {self.hidden_size}"
            )

    @property
    def step_cost(self) -> float:
        """A minibatch's pass through the network, which has one hidden layer more."""
        return self._pass_cost(self.hidden_layers + 1)

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


@hyperparameters
class TD3Hyperparameters(_OffPolicy, agent="td3"):
    """TD3 (Fujimoto et al., 2018) with Gumbel-Softmax actions (Jang et al., 2017).

    The paper's table gives the start temperature alone; noise and delay are TD3's
    usual ones, which its authors' code has too.
    """

    #: Temperatures stay within: below, gradients vanish; above, actions are all alike.
    temperatures: ClassVar[tuple[float, float]] = (0.1, 10.0)

    #: Gradient steps of the critics for each of actor and targets.
    policy_delay: Annotated[int, Field(ge=1, le=1000)] = 2
    action_noise: _Noise = 0.1  #: Standard deviation of what is added to relaxed actions.
    target_noise: _Noise = 0.2  #: Standard deviation of the targets' smoothing.
    target_noise_clip: _Noise = 0.5  #: Largest noise of the targets' smoothing.
    #: Temperature of the Gumbel-Softmax in the beginning; it is learned.
    initial_temperature: Annotated[float, Field(ge=0.1, le=10.0)] = 1.0

    @property
    def step_cost(self) -> float:
        """A minibatch's pass through both critics."""
        return 2 * super().step_cost

    def networks(self, state_size: int, n_actions: int) -> tuple[Network, Network]:
        """The shapes of actor and critic."""
        actor, critic = (
            network(inputs, self.hidden_size, self.hidden_layers, outputs, self.activation)
            for inputs, outputs in ((state_size, n_actions), (state_size + n_actions, 1))
        )
        return actor, critic
