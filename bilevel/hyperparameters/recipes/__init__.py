"""Recipes: every hyperparameter of an NES run, one complete data file each.

name        what it is
---------   ----------------------------------------------------------------------------
default     ours: SEs from random starts, in minutes
paper       Algorithm 1 as printed, with the paper's tables
authors     the update rule, transforms and ties of the authors' code
distilled   the supervised baseline: a start distilled from values of the real task

A name has a file of its own for each task that it was tuned for, `NAME-TASK.toml`, and one for any
other task, `NAME.toml`. The keys `agents` and `vary_agent` tell which agents evaluations draw; a
section each holds the hyperparameters of NES, the SE and every agent.
"""

import json
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol

from bilevel.decode import decode
from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters.agents import AgentHyperparameters, agent_hyperparameters
from bilevel.hyperparameters.definitions import (
    Hyperparameters,
    NESHyperparameters,
    SEHyperparameters,
    Variation,
)

#: The recipes that come with the package.
RECIPES = ("default", "paper", "authors", "distilled")


class _Task(Protocol):
    @property
    def id(self) -> str:
        """Of a task of gymnasium."""


@dataclass(frozen=True)
class _Recipe:
    """What every recipe file holds, besides a section an agent."""

    agents: tuple[str, ...]
    vary_agent: Variation
    nes: dict[str, Any]
    se: dict[str, Any]


def load_recipe(
    name: str | Path, task: _Task | str, agents: Sequence[str] | str | None = None
) -> Hyperparameters:
    """A recipe for a task (or its id; '' is none in particular), by name or as the path of a file
    (`*.toml`).

    `agents`, one name or several, replaces those that the recipe draws. An agent of a user's own
    has the defaults of the fields that the recipe does not give. Raises InvalidInput for an unknown
    name, for a file that is not a recipe, and for one that lacks a built-in agent or one of its
    fields.
    """
    name = str(name)
    values, what = _read(name, task if isinstance(task, str) else task.id), f"recipe {name!r}"
    known = [spec.name for spec in fields(_Recipe)]
    recipe = decode(_Recipe, {key: values[key] for key in known if key in values}, what)
    agents = (agents,) if isinstance(agents, str) else agents
    names = recipe.agents if agents is None else agents
    for key in values:
        if key not in (*known, *names):
            _require_agent(key, (*known, *names), what)
            _agent(key, values, what)  # sound, although this run does not draw it
    agents_of_it = tuple(_agent(agent, values, what) for agent in names)
    with _named(what):
        return Hyperparameters(
            nes=NESHyperparameters(**recipe.nes),
            se=SEHyperparameters(**recipe.se),
            agents=agents_of_it,
            vary_agent=recipe.vary_agent,
            recipe=Path(name).stem,
        )


def default_agents(names: Sequence[str]) -> tuple[AgentHyperparameters, ...]:
    """These agents with the paper's default hyperparameters (Table "Default HPs"), of no task in
    particular."""
    return load_recipe("paper", "", names).agents


@contextmanager
def _named(what: str) -> Iterator[None]:
    """Within the block, messages about wrong values begin with the recipe."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput(f"{what}: {error}") from None


def _require_agent(key: str, allowed: Sequence[str], what: str) -> None:
    """Raise InvalidInput unless the key is the name of an agent, which this run may not draw."""
    try:
        agent_hyperparameters(key)
    except InvalidInput:
        raise InvalidInput(
            f"{what}: unknown entry {key!r}: allowed are {', '.join(allowed)}, and sections of "
            "other agents"
        ) from None


def _agent(name: str, values: dict[str, Any], what: str) -> AgentHyperparameters:
    """An agent's section of a recipe; a built-in agent's gives all fields. Raises InvalidInput."""
    kind = agent_hyperparameters(name)
    built_in = kind.__module__ == AgentHyperparameters.__module__
    if built_in and name not in values:
        raise InvalidInput(f"{what} has no section [{name}], for the agent of that name")
    given = decode(dict[str, Any], values.get(name, {}), f"{what}, {name}")
    missing = [spec.name for spec in fields(kind) if spec.name not in given]
    if built_in and missing:
        raise InvalidInput(f"{what}, {name}: {missing[0]!r} is missing")
    with _named(what):
        return kind(**given)


def _read(name: str, task_id: str) -> dict[str, Any]:
    if name in RECIPES:
        own = files(__name__) / f"{name}-{task_id}.toml"
        file = own if own.is_file() else files(__name__) / f"{name}.toml"
        return tomllib.loads(file.read_text())
    if not name.endswith(".toml"):
        raise one_of("recipe", name, (*RECIPES, "and paths of recipe files (*.toml)"))
    try:
        return tomllib.loads(Path(name).read_text())
    except OSError as error:
        raise InvalidInput(f"cannot read the recipe {name!r}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(f"recipe {name!r} is not a TOML file: {error}") from None


def recipe_text(hp: Hyperparameters, heading: str) -> str:
    """The file of a recipe with these hyperparameters; `heading` comes first, as a comment."""
    agents = ", ".join(f'"{agent.agent}"' for agent in hp.agents)
    lines = [f"# {line}" for line in heading.splitlines()]
    lines += ["", f"agents = [{agents}]", f'vary_agent = "{hp.vary_agent}"']
    for name, section in hp.sections.items():
        # JSON writes strings, numbers and booleans as TOML does.
        lines += ["", f"[{name}]"]
        given = {field: value for field, value in asdict(section).items() if value is not None}
        lines += [f"{field} = {json.dumps(value)}" for field, value in given.items()]
    return "\n".join(lines) + "\n"
