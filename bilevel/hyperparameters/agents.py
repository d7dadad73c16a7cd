"""Hyperparameters of the agents, whose defaults are the paper's Table "Default HPs".

Defining a class registers it under its agent's name.
"""

import re
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field

from bilevel.errors import InvalidInput, unknown_value
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.networks import Network, network

#: The names of `bilevel.networks.CODES`.
Activation = Literal["tanh", "relu", "lrelu", "prelu"]
ACTIVATIONS: tuple[str, ...] = get_args(Activation)

_Episodes = Annotated[int, Field(ge=1, le=1_000_000)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_Noise = Annotated[float, Field(ge=0.0, le=10.0)]

_REGISTRY: dict[str, type["AgentHyperparameters"]] = {}

#: An agent's name is a section of recipes, which use some names for other things.
_RESERVED = ("nes", "se", "agents", "vary_agent", "extends", "tasks", "continuous")


@hyperparameters
class AgentHyperparameters:
    """Hyperparameters of every agent: the length of training and of tests.

    A custom agent subclasses it with its name, `class
    MyHyperparameters(AgentHyperparameters, agent="mine")`, uses the same decorator and adds fields.
    """

    agent: ClassVar[str] = ""

    #: Episodes before the first gradient step.
    init_episodes: Annotated[int, Field(ge=0, le=1_000_000)] = 10
    max_episodes: _Episodes = 1000  #: n_e, the maximum number of training episodes.
    #: d: training stops early if the mean return of the last d episodes differs from the mean of
    #: the d episodes before them by a share of at most C_diff (`early_out_difference`).
    early_out_episodes: _Episodes = 10
    early_out_difference: Annotated[float, Field(ge=0.0, le=1e6)] = 0.01  #: C_diff.
    test_episodes: _Episodes = 10  #: n_te, the episodes of a test on the real task.

    def __init_subclass__(cls, agent: str = "", **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if not agent:
            return
        if not re.fullmatch("[A-Za-z0-9_-]+", agent) or agent in _RESERVED:
            raise InvalidInput(f"the agent name {agent!r} is not allowed")
        taken = _REGISTRY.get(agent, cls)
        # Loading a file again is allowed.
        if (taken.__module__, taken.__qualname__) != (cls.__module__, cls.__qualname__):
            raise InvalidInput(
                f"the agent name {agent!r} is taken by {taken.__module__}.{taken.__qualname__}"
            )
        cls.agent = agent
        _REGISTRY[agent] = cls

    def require_learning(self, patient_episodes: int = 0) -> None:
        """Raise InvalidInput if training, or that of patient agents unless `patient_episodes` is 0,
        ends before the first gradient step."""
        longest = min(self.max_episodes, patient_episodes or self.max_episodes)
        if self.init_episodes >= longest:
            limits = f"{self.agent}.max_episodes"
            limits += " and nes.patient_episodes" if patient_episodes else ""
            raise InvalidInput(
                f"{self.agent}.init_episodes must be below {limits}, {longest}; "
                f"got {self.init_episodes}"
            )

    @property
    def step_cost(self) -> float:
        """Approximate cost of a gradient step, for schedules and variation: multiplications of a
        minibatch's forward pass. The default suits agents without a compiled kernel."""
        return 1e7

    def core_seconds(self, train_steps: int) -> float:
        """Estimate the core seconds of training, equally on every machine. The constants were
        measured for DDQN on a fast core (docs/speed.md)."""
        return train_steps * (1.2e-5 + 1e-10 * self.step_cost)


def keep_hyperparameters(cls: type[AgentHyperparameters]) -> None:
    """Register a class under its agent's name."""
    _REGISTRY[cls.agent] = cls


def agent_names() -> tuple[str, ...]:
    """Return the names of all registered agents."""
    return tuple(_REGISTRY)


def agent_hyperparameters(agent: str) -> type[AgentHyperparameters]:
    """Return the class of an agent's hyperparameters. Raises InvalidInput for an unknown name."""
    if agent not in _REGISTRY:
        raise unknown_value("agent", agent, agent_names())
    return _REGISTRY[agent]


def default_agents(names: Sequence[str]) -> tuple[AgentHyperparameters, ...]:
    """Return these agents with default hyperparameters (built-in agents: Table "Default HPs")."""
    return tuple(agent_hyperparameters(name)() for name in names)


@hyperparameters
class _OffPolicy(AgentHyperparameters):
    """Hyperparameters that the three agents of the paper share."""

    batch_size: Annotated[int, Field(ge=1, le=65536)] = 128  #: Transitions per gradient step.
    learning_rate: Annotated[float, Field(ge=1e-8, le=1.0)] = 0.001  #: Learning rate of Adam.
    target_update_rate: _Share = 0.01  #: tau of the soft target update.
    discount: _Share = 0.99  #: gamma.
    hidden_layers: Annotated[int, Field(ge=1, le=3)] = 2  #: Hidden layers of each network.
    hidden_size: Annotated[int, Field(ge=1, le=4096)] = 128  #: Units per hidden layer.
    activation: Activation = "relu"  #: Activation of the hidden layers.
    #: Capacity of the replay memory in transitions.
    replay_capacity: Annotated[int, Field(ge=1, le=100_000_000)] = 100_000

    @property
    def step_cost(self) -> float:
        """See `AgentHyperparameters.step_cost`."""
        return self._pass_cost(self.hidden_layers)

    def _pass_cost(self, hidden_layers: int) -> float:
        """Multiplications of a forward pass; the first and last layer count as narrow."""
        between = self.hidden_size * (hidden_layers - 1)
        return float(self.batch_size * self.hidden_size * (between + 8))


@hyperparameters
class DDQNHyperparameters(_OffPolicy, agent="ddqn"):
    """Double DQN (van Hasselt et al., 2016), as the inner loop trains it."""

    dueling: ClassVar[bool] = False

    #: Share of random actions: its initial value, minimum, and factor per episode. The table does
    #: not give the first two.
    initial_epsilon: _Share = 1.0
    minimal_epsilon: _Share = 0.01
    epsilon_decay: _Share = 0.9

    def network(self, state_size: int, action_size: int) -> Network:
        """Return the shape of the Q-network."""
        return network(
            state_size, self.hidden_size, self.hidden_layers, action_size, self.activation
        )


@hyperparameters
class DuelingDDQNHyperparameters(DDQNHyperparameters, agent="dueling-ddqn"):
    """Dueling Double DQN (Wang et al., 2016): DDQN with a dueling network."""

    dueling: ClassVar[bool] = True

    hidden_size: Annotated[int, Field(ge=2, le=4096)] = 128  #: One or more units per stream.

    @property
    def step_cost(self) -> float:
        """See `AgentHyperparameters.step_cost`; the network has one more hidden layer."""
        return self._pass_cost(self.hidden_layers + 1)

    def network(self, state_size: int, action_size: int) -> Network:
        """Return the shape of the Q-network. Half of the units of an additional hidden layer belong
        to the value, half to the advantages."""
        of_value = (self.hidden_size + 1) // 2
        return network(
            state_size,
            self.hidden_size,
            self.hidden_layers + 1,
            1 + action_size,
            self.activation,
            heads=((of_value, 1), (self.hidden_size - of_value, action_size)),
        )


@hyperparameters
class TD3Hyperparameters(_OffPolicy, agent="td3"):
    """TD3 (Fujimoto et al., 2018), for discrete actions with Gumbel-Softmax actions (Jang et al.,
    2017). Noise and policy delay, which the table does not give, are those of Fujimoto et al. and
    of the authors' code."""

    #: Range of the temperature. Below it gradients vanish; above it all actions are alike.
    temperatures: ClassVar[tuple[float, float]] = (0.1, 10.0)

    learning_rate: Annotated[float, Field(ge=1e-8, le=1.0)] = 0.0005  #: Learning rate of Adam.
    activation: Activation = "tanh"  #: Activation of the hidden layers.
    #: Gradient steps of the critics per step of the actor and the targets.
    policy_delay: Annotated[int, Field(ge=1, le=1000)] = 2
    action_noise: _Noise = 0.1  #: Standard deviation of the exploration noise.
    target_noise: _Noise = 0.2  #: Standard deviation of target smoothing.
    target_noise_clip: _Noise = 0.5  #: Bound on the noise of target smoothing.
    #: Initial temperature of the Gumbel-Softmax, which is learned (discrete actions only).
    initial_temperature: Annotated[float, Field(ge=0.1, le=10.0)] = 1.0

    @property
    def step_cost(self) -> float:
        """See `AgentHyperparameters.step_cost`: both critics."""
        return 2 * super().step_cost

    def networks(self, state_size: int, action_size: int) -> tuple[Network, Network]:
        """Return the shapes of actor and critic."""
        actor, critic = (
            network(inputs, self.hidden_size, self.hidden_layers, outputs, self.activation)
            for inputs, outputs in ((state_size, action_size), (state_size + action_size, 1))
        )
        return actor, critic


@hyperparameters
class PPOHyperparameters(AgentHyperparameters, agent="ppo"):
    """PPO (Schulman et al., 2017), with separate networks for policy and values."""

    #: Gains of the output layers of policy and value network (Huang et al., 2022).
    output_gains: ClassVar[tuple[float, float]] = (0.01, 1.0)

    init_episodes: Annotated[int, Field(ge=0, le=1_000_000)] = 0  #: Episodes without learning.
    rollout_steps: Annotated[int, Field(ge=2, le=65536)] = 128  #: Steps between two updates.
    epochs: Annotated[int, Field(ge=1, le=1000)] = 10  #: Passes over a rollout per update.
    #: Transitions per gradient step; at most `rollout_steps` are used.
    batch_size: Annotated[int, Field(ge=1, le=65536)] = 64
    learning_rate: Annotated[float, Field(ge=1e-8, le=1.0)] = 0.001  #: Learning rate of Adam.
    discount: _Share = 0.99  #: gamma.
    advantage_decay: _Share = 0.95  #: lambda of generalized advantage estimation.
    clip: Annotated[float, Field(gt=0.0, le=10.0)] = (
        0.2  #: Bound on the change of probability ratios.
    )
    entropy: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0  #: Weight of the policy's entropy.
    gradient_norm: Annotated[float, Field(gt=0.0, le=1e6)] = 0.5  #: Maximum norm of a gradient.
    hidden_layers: Annotated[int, Field(ge=1, le=3)] = 2  #: Hidden layers of each network.
    hidden_size: Annotated[int, Field(ge=1, le=4096)] = 64  #: Units per hidden layer.
    activation: Activation = "tanh"  #: Activation of the hidden layers.

    @property
    def minibatch(self) -> int:
        """Number B of transitions per gradient step."""
        return min(self.batch_size, self.rollout_steps)

    @property
    def step_cost(self) -> float:
        """See `AgentHyperparameters.step_cost`, per environment step: both networks see each
        transition `epochs` times."""
        between = self.hidden_size * (self.hidden_layers - 1)
        return float(2 * self.epochs * self.hidden_size * (between + 8))

    def networks(self, state_size: int, action_size: int) -> tuple[Network, Network]:
        """Return the shapes of policy and value network."""
        policy, value = (
            network(state_size, self.hidden_size, self.hidden_layers, outputs, self.activation)
            for outputs in (action_size, 1)
        )
        return policy, value
