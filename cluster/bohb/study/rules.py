"""What a search may search: the rules between its space, its recipe and what the user has set."""

from collections.abc import Collection, Sequence
from typing import Any

from bilevel.agents.variation import VARIED
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.nes.rules import RULES
from bilevel.synthetic_env import least_units
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
    """The space of a search on the task that leaves all else to `base`: with SEs that are large
    enough for the task.

    `replaced` are the hyperparameters of `base` that the user has set, with their values; the
    search begins with them if the `prior` is `recipe`. Raises InvalidInput for one that has no
    effect, for a space that does not go with `base`, and for one whose configurations NES does not
    allow.
    """
    for name, value in replaced:
        if name in SET_BY_SEARCH:
            raise InvalidInput(
                f"{name} cannot be set to {value} in a search: all of its runs end once an SE is "
                "confirmed, in the same way"
            )
    unread = RULES[base.nes.update].needs_pairs  # mirrored_sampling and score_transform
    if space == Space("full") and (unread or base.se.structure != "plain"):
        raise InvalidInput(
            "the space 'full' needs plain SEs and the rule paper or authors (--recipe authors or "
            f"paper); the recipe {base.recipe!r} has {base.se.structure} SEs and the rule "
            f"{base.nes.update}"
        )
    agents = [agent.agent for agent in base.agents]
    unread_ones = _unread(base, space.searched(agents))
    if space == Space("core"):
        space = space.without(unread_ones)
    for name in unread_ones.keys() & space.searched(agents):
        raise InvalidInput(
            f"the search space {space.name!r} has {name}, which has no effect: {unread_ones[name]}"
        )
    searched, where = space.searched(agents), f"is searched in the space {space.name!r}"
    for name, value in replaced:
        if name in searched and prior != "recipe":
            raise InvalidInput(
                f"{name} {where}, so that setting it to {value} has no effect: leave it out, or "
                "begin with it (--prior recipe)"
            )
    for name in (f"{agent}.{field}" for agent in agents for field in VARIED):
        if name in searched and base.vary_agent != "no":
            raise InvalidInput(
                f"{name} {where}, but runs draw it anew for each agent (--vary-hp "
                f"{base.vary_agent}): give --vary-hp no, or another space"
            )
    if base.se.structure == "exogenous":
        space = space.fitting("se.hidden_size", least_units(task))
    space.check(base, SET_BY_SEARCH, lambda hp: NES(task, hp))
    return space


def _unread(base: Hyperparameters, searched: Collection[str]) -> dict[str, str]:
    """Hyperparameters that NES does not read beside the others of `base`, and why; not where what
    decides it is `searched` too."""
    found = {}
    if base.se.structure == "plain" and "se.structure" not in searched:
        found["se.spread"] = "only exogenous SEs have a spread"
    if not RULES[base.nes.update].transforms and "nes.update" not in searched:
        why = f"the rule {base.nes.update} ranks the scores in its own way"
        found |= dict.fromkeys(("nes.score_transform", "nes.ties"), why)
    if base.nes.start == "distilled" and "nes.start" not in searched:
        found["nes.start_candidates"] = "the start is distilled"
    return found
