"""The interface of agents, and their registry by name.

An agent is a class, in torch or not, with the five methods of `Agent`, which the loop of
`bilevel.agents.training` calls. The built-in agents also have compiled twins, for speed; other
agents need none. See docs/agents.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from importlib.metadata import entry_points
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import is_pydantic_dataclass

from bilevel.agents.variation import VARIED
from bilevel.errors import InvalidInput, first_line, one_of
from bilevel.hyperparameters import AgentHyperparameters, agent_hyperparameters
from bilevel.hyperparameters.agents import keep_hyperparameters
from bilevel.hyperparameters.validation import has_plain_range
from bilevel.seeds import split
from bilevel.user_code import digest_of

#: Group of entry points in which packages name modules that register agents.
ENTRY_POINTS = "bilevel.agents"


class Transition(NamedTuple):
    """One step of an environment."""

    state: NDArray[np.float32]  # (S,)
    action: int
    reward: float
    next_state: NDArray[np.float32]  # (S,)
    done: float  # raw done output; the episode ends above 0.5


class Agent(Protocol):
    """Interface of an agent, built by `build(hp, state_size, n_actions, seed)`.

    All random numbers of an agent must come from that seed, so that an evaluation depends on its
    request alone.
    """

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """Choose a training action in a state (S,); `exploring` is true in the initial episodes."""

    def greedy(self, state: NDArray[np.float32]) -> int:
        """Choose the action in tests, in a state (S,)."""

    def observe(self, transition: Transition) -> None:
        """Receive the transition that the last action caused."""

    def learn(self) -> float:
        """Learn from the transitions so far; return the loss, 0 if there is none.

        Called after every step once the initial episodes are over. A non-finite loss ends training.
        """

    def end_episode(self) -> None:
        """Handle the end of a training episode."""


Build = Callable[[Any, int, int, int], Agent]


@dataclass(frozen=True)
class RegisteredAgent:
    """A registered agent.

    `build_kernel(hp, state_size, n_actions, rng)` builds the initial state of the compiled twin,
    with parameters drawn by `rng`; `kernel_parameters` lists these parameters.
    """

    name: str
    build: Build
    build_kernel: Callable[[Any, int, int, np.random.Generator], Any] | None = None
    kernel_parameters: Callable[[Any], list[NDArray[np.float32]]] | None = None

    @property
    def code_digest(self) -> str | None:
        """Digest of the user's code that defines it, its class and hyperparameters; None for a
        built-in agent. It is that of the file when it was first asked for: the process goes on with
        the code that it has imported."""
        return _code_digest(self.name)


@cache
def _code_digest(name: str) -> str | None:
    return digest_of("bilevel", get_agent(name).build, agent_hyperparameters(name))


_AGENTS: dict[str, RegisteredAgent] = {}


def register_agent(
    hyperparameters: type[AgentHyperparameters],
    build: Build,
    build_kernel: Callable[[Any, int, int, np.random.Generator], Any] | None = None,
    kernel_parameters: Callable[[Any], list[NDArray[np.float32]]] | None = None,
) -> None:
    """Register an agent under the name in its hyperparameter class.

    Raises InvalidInput for a class that the decorator `hyperparameters` does not check, for one
    that names no agent of its own, and for a range that `variation` could not keep to.
    """
    name, given = hyperparameters.agent, hyperparameters.__name__
    named = bool(name) and agent_hyperparameters(name) is hyperparameters
    if not is_pydantic_dataclass(hyperparameters):
        raise InvalidInput(f"{given} must be decorated with `hyperparameters`")
    if not named:
        raise InvalidInput(
            f"{given} must name its agent, another one than those of other classes: "
            f'`class {given}(..., agent="mine")`'
        )
    for spec in fields(hyperparameters):
        if spec.name in VARIED and not has_plain_range(hyperparameters, spec.name):
            raise InvalidInput(
                f"{given}.{spec.name} is varied, so that its range must be given as "
                "`Field(ge=..., le=...)` alone"
            )
    _AGENTS[name] = RegisteredAgent(name, build, build_kernel, kernel_parameters)


def register_again(hyperparameters: type[AgentHyperparameters], agent: RegisteredAgent) -> None:
    """Make an agent that another process has registered known to this one."""
    keep_hyperparameters(hyperparameters)
    _AGENTS[agent.name] = agent


def load_plugins() -> None:
    """Import the modules that installed packages name under `bilevel.agents`. Raises InvalidInput
    for one that cannot be imported."""
    for entry in entry_points(group=ENTRY_POINTS):
        try:
            entry.load()
        except Exception as error:
            told = f"{type(error).__name__}: {first_line(error)}"
            raise InvalidInput(
                f"the installed agent {entry.name!r} ({entry.value}) cannot be imported: {told}"
            ) from error


def get_agent(name: str) -> RegisteredAgent:
    """The agent of that name. Raises InvalidInput for an unknown one."""
    if name not in _AGENTS:
        load_plugins()
    if name not in _AGENTS:
        raise one_of("agent", name, (*registered_agents(), "and those that a file registers"))
    return _AGENTS[name]


def registered_agents() -> tuple[str, ...]:
    """Names of all agents, including those of installed packages."""
    load_plugins()
    return tuple(_AGENTS)


def agent_seeds(seed: int) -> tuple[int, int]:
    """Seeds of a built-in agent: of its initial parameters, and of its exploration, noise and
    minibatches."""
    initial, loop = split(seed, 2)
    return initial, loop
