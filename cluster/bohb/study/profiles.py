"""Sizes of searches, and the adaptation of recipes and search spaces to them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from bilevel.agents.variation import VARIED
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import CONFIRMING_AGENTS, Hyperparameters
from bilevel.nes import NES
from bilevel.tasks import Task
from search_spaces import SPACES
from search_spaces.space import Space
from search_spaces.translation import to_hyperparameters

#: Titles of the methods. `bohb` samples from hpbandster's model and the others at random; `random`
#: runs every configuration at the largest budget.
METHODS = {"bohb": "BOHB", "hyperband": "Hyperband", "random": "random search"}

#: Number of brackets of a search that only its time budget ends.
ENDLESS = 1000

#: Hyperparameters that end a run. They are the same for all configurations of a search, because the
#: objective is the time until a run ends.
_SET_BY_SEARCH = "nes.solved_for", "nes.confirming_agents"
#: Random configurations that are checked.
_SAMPLES = 256
#: Used for recipes whose runs never stop early (`paper`, `authors`).
_SOLVED_FOR = 4
#: Episodes of one step, for each longer episode of a profile.
_SHORT_EPISODES = 20


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Size of a search. Budgets are estimated core seconds of a configuration (`core_seconds`)."""

    recipe: str = "default"
    space: str = "core"
    prior: str = "none"  # or recipe, see `ConfigGenerator`
    smallest_budget: int
    largest_budget: int
    cycle: int | None = None  # see `Schedule`; None is Hyperband's
    brackets: int
    time_budget: float | None = None  # seconds; None runs all brackets
    final_agents: int = 10  # trained on the best SE at the end, with fresh seeds
    # None keeps the recipe's value.
    population: int | None = None
    centre_agents: int | None = None
    max_episodes: int | None = None  # of an agent's training, on SEs with longer episodes


PROFILES = {
    # A quick check of all three layers.
    "smoke": Profile(
        smallest_budget=1,
        largest_budget=3,
        brackets=2,
        final_agents=4,
        centre_agents=2,
        max_episodes=15,
    ),
    # Half an hour on a laptop. The first configuration is the recipe, so that even a dozen
    # configurations are compared with it.
    "local": Profile(
        prior="recipe",
        smallest_budget=30,
        largest_budget=270,
        cycle=1,
        brackets=ENDLESS,
        time_budget=30 * 60.0,
    ),
    # The scale of the paper's table "Fixed hyperparameters": about 200 generations.
    "paper": Profile(
        recipe=SPACES["full"],
        space="full",
        smallest_budget=100,
        largest_budget=2700,
        brackets=12,
        population=16,
    ),
}


def sized(hp: Hyperparameters, profile: Profile) -> Hyperparameters:
    """Apply a profile to a recipe; its runs stop once an SE is confirmed."""
    nes = replace(
        hp.nes,
        solved_for=hp.nes.solved_for or _SOLVED_FOR,
        confirming_agents=hp.nes.confirming_agents or CONFIRMING_AGENTS,
        population_size=profile.population or hp.nes.population_size,
        centre_agents=profile.centre_agents or hp.nes.centre_agents,
    )
    episodes = profile.max_episodes
    if episodes is None:
        return replace(hp, nes=nes)
    if hp.se.family == "one-step":
        episodes *= _SHORT_EPISODES
    agents = tuple(
        replace(
            agent,
            init_episodes=min(agent.init_episodes, max(episodes // 10, 1)),
            max_episodes=min(agent.max_episodes, episodes),
        )
        for agent in hp.agents
    )
    nes = replace(nes, patient_episodes=min(nes.patient_episodes, episodes))
    return replace(hp, nes=nes, agents=agents)


def searched_space(
    space: Space,
    task: Task,
    base: Hyperparameters,
    given: Mapping[str, Any] = {},
    prior: str = "none",
) -> Space:
    """Return the space of a study on `task`; `core` is adapted to the task and to `base`.

    `given` has the hyperparameters of `base` that the user has set. Raises InvalidInput if one
    of them has no effect, or if NES rejects a configuration.
    """
    if space == Space("core"):
        space = _adapted_core(base)
    agents = [agent.agent for agent in base.agents]
    searched = space.searched(agents)
    for name in _SET_BY_SEARCH:
        if name in searched or name in given:
            raise InvalidInput(f"{name} cannot be set in a search: all runs end in the same way")
    for name in sorted(searched & given.keys()) if prior != "recipe" else ():
        raise InvalidInput(
            f"{name} is searched in the space {space.name!r}, so that setting it to "
            f"{given[name]} has no effect: leave it out, or use --prior recipe"
        )
    varied = searched & {f"{agent}.{field}" for agent in agents for field in VARIED}
    if varied and base.vary_agent != "no":
        raise InvalidInput(
            f"the space {space.name!r} searches {', '.join(sorted(varied))}, but runs draw these "
            f"for each agent (--vary-hp {base.vary_agent}): give --recipe authors or --vary-hp no"
        )
    built = space.build(agents, seed=0)
    default = built.get_default_configuration()
    for configuration in (default, *built.sample_configuration(_SAMPLES)):
        try:
            NES(task, to_hyperparameters(base, dict(configuration)))
        except InvalidInput as error:
            raise InvalidInput(f"search space {space.name!r}: {error}") from None
    return space


def _adapted_core(base: Hyperparameters) -> Space:
    """Return `core`, without the spread of states unless SEs have episodes of one step."""
    import ConfigSpace as CS

    if base.se.family == "one-step":
        return Space("core")
    dimensions = [d for name, d in Space("core").build().items() if name != "se.spread"]
    return Space("core", CS.ConfigurationSpace("core", space=dimensions).to_serialized_dict())
