"""Checks of a search space against the recipe and the hyperparameters that a user has set."""

from collections.abc import Sequence
from typing import Any

from bilevel.agents.variation import VARIED
from bilevel.errors import InvalidInput
from bilevel.evolution import RULES
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.synthetic_env import smallest_hidden_size
from bilevel.tasks import Task
from cluster.bohb.study.profiles import SET_BY_SEARCH
from search_spaces.space import Space


def searched_space(
    space: Space,
    task: Task,
    base: Hyperparameters,
    replaced: Sequence[tuple[str, Any]] = (),
    prior: str = "none",
) -> Space:
    """Return the space of a study on `task`; `core` is adapted to the task and to `base`.

    `replaced` has the hyperparameters of `base` that the user has set. Raises InvalidInput if one
    of them has no effect, if the space does not suit `base`, or if NES rejects a configuration.
    """
    for name, value in replaced:
        if name in SET_BY_SEARCH:
            raise InvalidInput(
                f"{name} cannot be set to {value} in a search: all of its runs end once an SE is "
                "confirmed, in the same way"
            )
    if space == Space("core"):
        space = _adapted_core(task, base)
    elif space == Space("full"):
        _check_full(base)
    agents = [agent.agent for agent in base.agents]
    searched = space.searched(agents)
    for name, value in replaced if prior != "recipe" else ():
        if name in searched:
            raise InvalidInput(
                f"{name} is searched in the space {space.name!r}, so that setting it to {value} "
                "has no effect: leave it out, or use --prior recipe"
            )
    for name in (f"{agent}.{field}" for agent in agents for field in VARIED):
        if name in searched and base.vary_agent != "no":
            raise InvalidInput(
                f"{name} is searched in the space {space.name!r}, but runs draw it for each "
                f"agent (--vary-hp {base.vary_agent}): give --vary-hp no, or another space"
            )
    space.check(base, SET_BY_SEARCH, lambda hp: NES(task, hp))
    return space


def _adapted_core(task: Task, base: Hyperparameters) -> Space:
    """Return `core` without the spread of plain SEs, or with exogenous SEs large enough for the
    task."""
    import ConfigSpace as CS

    dimensions = dict(Space("core").build())
    if base.se.family == "plain":
        del dimensions["se.spread"]
    else:
        size = dimensions["se.hidden_size"]
        units = smallest_hidden_size(task.state_size, task.n_actions)
        assert isinstance(size, CS.UniformIntegerHyperparameter)
        if units <= size.lower:
            return Space("core")
        ends = units, max(size.upper, 2 * units)
        dimensions[size.name] = CS.Integer(size.name, ends, log=size.log)
    space = CS.ConfigurationSpace(name="core", space=list(dimensions.values()))
    return Space("core", dict(space.to_serialized_dict()))


def _check_full(base: Hyperparameters) -> None:
    # `full` searches mirrored_sampling, which other rules need.
    if not RULES[base.nes.update].transforms or base.se.family != "plain":
        raise InvalidInput(
            "the space 'full' needs plain SEs and the rule paper or authors (--recipe authors or "
            f"paper); the recipe {base.recipe!r} has {base.se.family} SEs and the rule "
            f"{base.nes.update}"
        )
