"""Search methods, and profiles: named sizes of a search."""

from dataclasses import dataclass, replace

from bilevel.errors import unknown_value
from bilevel.hyperparameters import CONFIRMING_AGENTS, Hyperparameters
from search_spaces import SPACES

#: Titles of the methods. `bohb` samples from hpbandster's model and the others at random; `random`
#: runs every configuration at the largest budget.
METHODS = {"bohb": "BOHB", "hyperband": "Hyperband", "random": "random search"}

#: Priors of a search. With the recipe, the first configuration has the recipe's values, and about
#: half of the random ones are drawn around it.
PRIORS = ("none", "recipe")

#: Number of brackets of a search that only its time budget ends.
ENDLESS = 1000

#: Hyperparameters that end a run. They are the same for all configurations of a search, because the
#: objective is the time until a run ends.
SET_BY_SEARCH = ("nes.solved_for", "nes.confirming_agents")
#: Used for recipes whose runs never stop early (`paper`, `authors`).
_SOLVED_FOR = 4


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Size of a search. Budgets are estimated core seconds of a configuration (`core_seconds`)."""

    recipe: str = "default"
    space: str = "core"
    prior: str = "none"  # of PRIORS
    smallest_budget: int
    largest_budget: int
    cycle: int | None = None  # see `Schedule`; None is Hyperband's
    brackets: int
    time_budget: float | None = None  # seconds; None runs all brackets
    final_agents: int = 10  # trained on the best SE at the end, with fresh seeds
    # None keeps the recipe's value.
    population: int | None = None
    centre_agents: int | None = None
    max_episodes: int | None = None  # of an agent's training on an SE


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


def get_method(name: str) -> str:
    """Return the name of a known method. Raises InvalidInput."""
    if name not in METHODS:
        raise unknown_value("method", name, METHODS)
    return name


def get_profile(name: str) -> Profile:
    """Return the profile with that name. Raises InvalidInput."""
    if name not in PROFILES:
        raise unknown_value("profile", name, PROFILES)
    return PROFILES[name]


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
    agents = tuple(
        replace(
            agent,
            init_episodes=min(agent.init_episodes, episodes - 1),  # at least one to learn in
            max_episodes=min(agent.max_episodes, episodes),
        )
        for agent in hp.agents
    )
    nes = replace(nes, patient_episodes=min(nes.patient_episodes, episodes))
    return replace(hp, nes=nes, agents=agents)
