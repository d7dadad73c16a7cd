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

import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters.agents import agent_hyperparameters
from bilevel.hyperparameters.definitions import (
    Hyperparameters,
    NESHyperparameters,
    SEHyperparameters,
)

#: The recipes that come with the package.
RECIPES = ("default", "paper", "authors", "distilled")


class _Task(Protocol):
    @property
    def id(self) -> str:
        """Of a task of gymnasium."""


def load_recipe(
    name: str, task: _Task | str, agents: Sequence[str] | None = None
) -> Hyperparameters:
    """A recipe for a task (or its id), by name or as the path of a file (`*.toml`).

    `agents` replaces those that the recipe draws; one that it does not know has the defaults of
    its own fields. Raises InvalidInput for an unknown name, and for a file that is not a recipe.
    """
    values = _read(name, task if isinstance(task, str) else task.id)
    try:
        names = tuple(agents if agents is not None else values["agents"])
        return Hyperparameters(
            nes=NESHyperparameters.from_dict(values["nes"]),
            se=SEHyperparameters.from_dict(values["se"]),
            agents=tuple(
                agent_hyperparameters(agent).from_dict(values.get(agent, {})) for agent in names
            ),
            vary_agent=values["vary_agent"],
            recipe=Path(name).stem,
        )
    except KeyError as error:
        raise InvalidInput(f"recipe {name!r} lacks {error}") from None
    except (TypeError, AttributeError) as error:
        raise InvalidInput(f"recipe {name!r}: {error}") from None


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
