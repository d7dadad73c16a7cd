"""Methods of a search, and named sets of settings for its size."""

from dataclasses import dataclass, replace

from bilevel.errors import one_of
from bilevel.hyperparameters import CONFIRMING_AGENTS, Hyperparameters
from search_spaces import SPACES

#: Search methods and their titles. `bohb` proposes configurations with hpbandster's model, the
#: others at random; `random` runs all of them at the largest budget.
METHODS = {"bohb": "BOHB", "hyperband": "Hyperband", "random": "random search"}


#: A number of brackets that no time budget suffices for.
ENDLESS = 1000


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Size of a search.

    `time_budget`, in seconds, ends the search after the generations in flight; None runs all
    brackets. Budgets are core seconds of a configuration (`bilevel.cost`).
    """

    recipe: str = "default"
    space: str = "core"
    prior: str = "none"  # of the random configurations (`BracketSearch`)
    smallest_budget: int  # of the lowest rung
    largest_budget: int  # of the highest rung
    cycle: int | None = None  # see `Schedule`; None: Hyperband's
    brackets: int
    time_budget: float | None = None
    final_agents: int = 10  # trained on the best SE at the end, with fresh seeds
    # None: the recipe's.
    population: int | None = None
    centre_agents: int | None = None  # trained on the unperturbed SE
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
    # For a laptop, in half an hour. It begins with the recipe, so that what it hands over has been
    # compared with that, also where the time is enough for a dozen configurations alone.
    "local": Profile(
        prior="recipe",
        smallest_budget=30,
        largest_budget=270,
        cycle=1,
        brackets=ENDLESS,
        time_budget=30 * 60.0,
    ),
    # The paper's scale (Table "Fixed hyperparameters"): about 200 generations.
    "paper": Profile(
        recipe=SPACES["full"],
        space="full",
        smallest_budget=100,
        largest_budget=2700,
        brackets=12,
        population=16,
    ),
}


#: Hyperparameters that say when a run is over. A search compares configurations by how soon that
#: is, so all of them must mean the same by it.
SET_BY_SEARCH = ("nes.solved_for", "nes.confirming_agents")
#: Its value where the recipe has none: `paper` and `authors` never end early.
_SOLVED_FOR = 4


def get_method(name: str) -> str:
    """The method of that name. Raises InvalidInput for another name."""
    if name not in METHODS:
        raise one_of("method", name, METHODS)
    return name


def get_profile(name: str) -> Profile:
    """The profile of that name. Raises InvalidInput for another name."""
    if name not in PROFILES:
        raise one_of("profile", name, PROFILES)
    return PROFILES[name]


def sized(hp: Hyperparameters, profile: Profile) -> Hyperparameters:
    """The recipe `hp` in the profile's size; its runs end once an SE is confirmed."""
    nes = replace(
        hp.nes,
        solved_for=hp.nes.solved_for or _SOLVED_FOR,
        confirming_agents=hp.nes.confirming_agents or CONFIRMING_AGENTS,
    )
    if profile.population is not None:
        nes = replace(nes, population_size=profile.population)
    if profile.centre_agents is not None:
        nes = replace(nes, centre_agents=profile.centre_agents)
    agents, most = hp.agents, profile.max_episodes
    if most is not None:
        nes = replace(nes, patient_episodes=min(nes.patient_episodes, most))
        agents = tuple(
            replace(
                one,
                init_episodes=min(one.init_episodes, most - 1),  # so that it learns at all
                max_episodes=min(one.max_episodes, most),
            )
            for one in agents
        )
    return replace(hp, nes=nes, agents=agents)
