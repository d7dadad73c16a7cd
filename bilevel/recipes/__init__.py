"""Recipes: the hyperparameters of an NES run as TOML files that extend each other.

name        content
---------   ----------------------------------------------------------------------------------
default     SEs from scores only, in minutes, for any task
exogenous   SEs of the family `exogenous`, designed for CartPole and Acrobot
paper       the update as the paper prints it, with the paper's tables
authors     the update rule, transforms and ties of the authors' code

A recipe holds its differences from the recipe that it `extends`. `agents` and `vary_agent` select
the agents that evaluations draw. The sections `nes`, `se` and one per agent hold hyperparameters.
A section `continuous.SECTION` applies only to tasks with continuous actions, and a section
`tasks.ID.SECTION` only to the task ID, where they override the recipe's SECTION.
"""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol

from bilevel.decode import decode
from bilevel.errors import InvalidInput, unknown_value
from bilevel.hyperparameters import (
    AgentHyperparameters,
    Hyperparameters,
    NESHyperparameters,
    SEHyperparameters,
    Variation,
    agent_hyperparameters,
    default_agents,
)

#: The recipes and agents of this package.
RECIPES = ("default", "exogenous", "paper", "authors")
BUILT_IN_AGENTS = ("ddqn", "dueling-ddqn", "td3", "ppo")

_Values = dict[str, Any]


class _Task(Protocol):
    @property
    def id(self) -> str:
        """The gymnasium id."""

    @property
    def continuous(self) -> bool:
        """True if actions are vectors."""


def load_recipe(
    name: str | Path, task: _Task | str, agents: Sequence[str] | str | None = None
) -> Hyperparameters:
    """Return the hyperparameters of a recipe for a task, or for the id of a task with discrete
    actions ("" for any).

    `name` is a recipe of this package or the path of a file (`*.toml`). `agents`, one name or
    several, replaces the agents of the recipe. Fields of an agent that the recipe does not give
    have the defaults of its class. Raises InvalidInput for an unknown name, and for a file that is
    not a recipe or incomplete.
    """
    name = str(name)
    values, source = _resolved(name, task, ()), f"recipe {name!r}"
    names = decode(tuple[str, ...], values.pop("agents", ()), f"{source}: agents")
    if agents is not None:
        names = (agents,) if isinstance(agents, str) else tuple(agents)
    vary: Variation = values.pop("vary_agent", None)  # validated below
    sections = {key: decode(_Values, value, f"{source}, {key}") for key, value in values.items()}
    try:
        nes = NESHyperparameters(**sections.pop("nes", {}))
        se = SEHyperparameters(**sections.pop("se", {}))
        # Also the agents that this run does not draw are checked.
        known = {agent: agent_hyperparameters(agent)(**sections[agent]) for agent in sections}
        drawn = tuple(known.get(agent) or agent_hyperparameters(agent)() for agent in names)
        stem = Path(name).stem
        return Hyperparameters(nes=nes, se=se, agents=drawn, vary_agent=vary, recipe=stem)
    except InvalidInput as error:
        raise InvalidInput(f"{source}: {error}") from None


def usual_agents(
    task: _Task, one_step: bool, names: Sequence[str] | None = None
) -> tuple[AgentHyperparameters, ...]:
    """Return agents, by default those of the recipe `default`, with their usual hyperparameters:
    those of that recipe on SEs with episodes of one step, else the paper's Table "Default HPs".

    The table's agents would stop after some steps on such SEs. Raises InvalidInput for an unknown
    name.
    """
    agents = load_recipe("default", task, names).agents
    return agents if one_step else default_agents([agent.agent for agent in agents])


def complete_recipe(name: str | Path, task: _Task | str = "") -> str:
    """Return a recipe with all values, including those of built-in agents that it does not draw."""
    hp, task_id = load_recipe(name, task), task if isinstance(task, str) else task.id
    others = load_recipe(name, task, BUILT_IN_AGENTS).agents
    heading = f"The recipe {hp.recipe}" + (f" for {task_id}." if task_id else ".")
    drawn = {agent.agent for agent in hp.agents}
    return recipe_text(hp, heading, tuple(a for a in others if a.agent not in drawn))


def recipe_text(
    hp: Hyperparameters, heading: str, others: Sequence[AgentHyperparameters] = ()
) -> str:
    """Return a complete recipe file with these hyperparameters, after `heading` as a comment.

    `others` are agents that the recipe describes but does not draw.
    """
    agents = ", ".join(f'"{agent.agent}"' for agent in hp.agents)
    lines = [f"# {line}" for line in heading.splitlines()]
    lines += ["", f"agents = [{agents}]", f'vary_agent = "{hp.vary_agent}"']
    sections = hp.sections | {agent.agent: agent for agent in others}
    for name, section in sections.items():
        # JSON writes strings, numbers and booleans as TOML does.
        lines += ["", f"[{name}]"]
        lines += [f"{field} = {json.dumps(value)}" for field, value in asdict(section).items()]
    return "\n".join(lines) + "\n"


def _resolved(name: str, task: _Task | str, children: tuple[str, ...]) -> _Values:
    """Return the values of a recipe on top of those that it extends."""
    if name in children:
        raise InvalidInput(f"recipe {name!r} extends itself: {' -> '.join((*children, name))}")
    own = _read(name)
    parent, tasks, continuous = (own.pop(key, {}) for key in ("extends", "tasks", "continuous"))
    merged = _resolved(str(parent), task, (*children, name)) if parent else {}
    task_id, is_continuous = (task, False) if isinstance(task, str) else (task.id, task.continuous)
    for layer in (own, continuous if is_continuous else {}, tasks.get(task_id, {})):
        for key, value in layer.items():
            both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
            merged[key] = {**merged[key], **value} if both else value
    return merged


def _read(name: str) -> _Values:
    if name in RECIPES:
        return tomllib.loads((files(__name__) / f"{name}.toml").read_text())
    if not name.endswith(".toml"):
        raise unknown_value("recipe", name, (*RECIPES, "and paths of recipe files (*.toml)"))
    try:
        return tomllib.loads(Path(name).read_text())
    except (OSError, ValueError) as error:  # also TOMLDecodeError
        raise InvalidInput(f"cannot read the recipe {name!r}: {error}") from None
