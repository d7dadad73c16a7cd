"""The interface of agents, and their registry by name.

An agent is a class with the five methods of `Agent`, which the loop of `bilevel.agents.training`
calls. The built-in agents also have compiled twins (`bilevel.kernels.training.Kernel`). See
docs/agents.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import entry_points
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import is_pydantic_dataclass

from bilevel.errors import InvalidInput, first_line, unknown_value
from bilevel.hyperparameters import AgentHyperparameters, agent_hyperparameters
from bilevel.hyperparameters.agents import keep_hyperparameters
from bilevel.seeds import split
from bilevel.spaces import Action
from bilevel.user_code import digest_of

#: Group of entry points in which packages name modules that register agents.
ENTRY_POINTS = "bilevel.agents"


class Transition(NamedTuple):
    """One step of an environment."""

    state: NDArray[np.float32]  # (S,)
    action: Action
    reward: float
    next_state: NDArray[np.float32]  # (S,)
    done: float  # raw done output; the episode ends above 0.5


class Agent(Protocol):
    """Interface of an agent, built by `build(hp, state_size, action_size, seed)`.

    All random numbers of an agent must come from that seed, so that an evaluation depends on its
    request only.

    A discrete action is an index from 0, a continuous one a vector (M,) in [-1, 1]."""

    def act(self, state: NDArray[np.float32], exploring: bool) -> Action:
        """Choose a training action in a state (S,); `exploring` is true in the initial episodes."""

    def greedy(self, state: NDArray[np.float32]) -> Action:
        """Choose the action in tests, in a state (S,)."""

    def observe(self, transition: Transition) -> None:
        """Receive the transition that the last action caused."""

    def learn(self) -> float:
        """Learn from the transitions so far, after every step that follows the initial episodes;
        return the loss, 0 if there is none. A non-finite loss ends training."""

    def end_episode(self) -> None:
        """Handle the end of a training episode."""


Build = Callable[[Any, int, int, int], Agent]

#: Builds a compiled twin (`bilevel.kernels.training.Kernel`) from hyperparameters, state size and
#: number of actions; the generator draws its parameters.
BuildKernel = Callable[[Any, int, int, np.random.Generator], Any]


@dataclass(frozen=True)
class RegisteredAgent:
    """A registered agent: its definition, and its compiled twin if it has one."""

    name: str
    build: Build
    build_kernel: BuildKernel | None = None
    continuous: bool = False  #: whether it chooses action vectors instead of indices

    @cached_property
    def code_digest(self) -> str | None:
        """Digest of a user's agent and its hyperparameters, as imported; None if built in."""
        return digest_of("bilevel", self.build, agent_hyperparameters(self.name))


#: Agents by name and kind of actions.
_AGENTS: dict[tuple[str, bool], RegisteredAgent] = {}


def register_agent(
    hyperparameters: type[AgentHyperparameters],
    build: Build,
    build_kernel: BuildKernel | None = None,
    continuous: bool = False,
) -> None:
    """Register an agent for discrete or continuous actions, under the name in its hyperparameter
    class. An agent for both is registered twice. Raises InvalidInput for a class that lacks the
    decorator `hyperparameters` or its own name."""
    name, given = hyperparameters.agent, hyperparameters.__name__
    if not is_pydantic_dataclass(cast(type, hyperparameters)):
        raise InvalidInput(f"{given} must be decorated with `hyperparameters`")
    if not name or agent_hyperparameters(name) is not hyperparameters:
        raise InvalidInput(f'{given} must name its agent: `class {given}(..., agent="mine")`')
    _AGENTS[name, continuous] = RegisteredAgent(name, build, build_kernel, continuous)


def register_again(hyperparameters: type[AgentHyperparameters], agent: RegisteredAgent) -> None:
    """Register an agent of another process in this one."""
    keep_hyperparameters(hyperparameters)
    _AGENTS[agent.name, agent.continuous] = agent


def load_plugins() -> None:
    """Import the agents of installed packages. Raises InvalidInput if an import fails."""
    for entry in entry_points(group=ENTRY_POINTS):
        try:
            entry.load()
        except Exception as error:
            raise InvalidInput(
                f"the installed agent {entry.name!r} ({entry.value}) cannot be imported: "
                f"{type(error).__name__}: {first_line(error)}"
            ) from error


def get_agent(name: str, continuous: bool | None = None) -> RegisteredAgent:
    """The agent of that name, for continuous or discrete actions (None: for any). Raises
    InvalidInput for an unknown name, and for an agent without that kind of actions."""
    kinds = (False, True) if continuous is None else (continuous,)
    if not any((name, kind) in _AGENTS for kind in kinds):
        load_plugins()
    for kind in kinds:
        if (name, kind) in _AGENTS:
            return _AGENTS[name, kind]
    allowed = registered_agents(continuous)
    if name in registered_agents():
        actions = "continuous" if continuous else "discrete"
        raise InvalidInput(
            f"agent {name!r} has no {actions} actions: allowed are {', '.join(allowed)}"
        )
    raise unknown_value("agent", name, (*allowed, "and the agents of agent files"))


def registered_agents(continuous: bool | None = None) -> tuple[str, ...]:
    """Names of all agents for continuous or discrete actions (None: for any), including those of
    installed packages."""
    load_plugins()
    kinds = (False, True) if continuous is None else (continuous,)
    return tuple(dict.fromkeys(name for name, kind in _AGENTS if kind in kinds))


def agent_seeds(seed: int) -> tuple[int, int]:
    """Seeds of a built-in agent: of its initial parameters, and of everything else."""
    initial, loop = split(seed, 2)
    return initial, loop
