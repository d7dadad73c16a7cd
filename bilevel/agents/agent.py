"""What an agent is, and the agents there are by name.

An agent is a torch (or any) class with the five methods of `Agent`; the loop of
`bilevel.agents.training` calls them. The built-in ones have compiled twins beside
that, which is what makes them fast; another one needs none. See docs/agents.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import is_pydantic_dataclass

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters import AgentHyperparameters, agent_hyperparameters
from bilevel.seeds import split

#: Packages name modules that register agents under this group of entry points.
ENTRY_POINTS = "bilevel.agents"


class Transition(NamedTuple):
    """One step of an environment."""

    state: NDArray[np.float32]  # (S,)
    action: int
    reward: float
    next_state: NDArray[np.float32]  # (S,)
    done: float  # the raw output; the episode is over above 0.5


class Agent(Protocol):
    """The interface of an agent; it is built by `build(hp, state_size, n_actions, seed)`.

    All its random numbers come from that seed, so that an evaluation depends on its
    request alone.
    """

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """The next action in training; `exploring` while the initial episodes last."""

    def greedy(self, state: NDArray[np.float32]) -> int:
        """The action in tests."""

    def observe(self, transition: Transition) -> None:
        """What came of the last action."""

    def learn(self) -> float:
        """Called after every step once the initial episodes are over; returns a loss
        (0 if there is none). Training ends when it is not finite."""

    def end_episode(self) -> None:
        """Called at the end of every training episode."""


Build = Callable[[Any, int, int, int], Agent]


@dataclass(frozen=True)
class RegisteredAgent:
    """An agent by name. `build_kernel(hp, state_size, n_actions, rng)` makes the compiled
    twin's initial state, `rng` drawing its parameters; `kernel_parameters` lists these."""

    name: str
    build: Build
    build_kernel: Callable[[Any, int, int, np.random.Generator], Any] | None = None
    kernel_parameters: Callable[[Any], list[NDArray[np.float32]]] | None = None


_AGENTS: dict[str, RegisteredAgent] = {}


def register_agent(
    hyperparameters: type[AgentHyperparameters],
    build: Build,
    build_kernel: Callable[[Any, int, int, np.random.Generator], Any] | None = None,
    kernel_parameters: Callable[[Any], list[NDArray[np.float32]]] | None = None,
) -> None:
    """Make an agent known under the name that its hyperparameters give.

    Raises InvalidInput if these are not checked: the decorator `hyperparameters` does that.
    """
    name = hyperparameters.agent
    if not is_pydantic_dataclass(hyperparameters):
        raise InvalidInput(f"{hyperparameters.__name__} must be decorated with `hyperparameters`")
    _AGENTS[name] = RegisteredAgent(name, build, build_kernel, kernel_parameters)


def load_plugins() -> None:
    """Import the modules that installed packages name under `bilevel.agents`."""
    for entry in entry_points(group=ENTRY_POINTS):
        entry.load()


def get_agent(name: str) -> RegisteredAgent:
    """The agent of that name. Raises InvalidInput for an unknown one."""
    if name not in _AGENTS:
        load_plugins()
    if name not in _AGENTS:
        raise one_of("agent", name, registered_agents())
    agent_hyperparameters(name)
    return _AGENTS[name]


def registered_agents() -> tuple[str, ...]:
    """The names of all agents, those of installed packages among them."""
    load_plugins()
    return tuple(_AGENTS)


def agent_seeds(seed: int) -> tuple[int, int]:
    """Of a built-in agent: the seed of its initial parameters, and that of its
    exploration, noise and minibatches."""
    initial, loop = split(seed, 2)
    return initial, loop
