"""How a search goes: its method, and its size in named sets of settings, each of them
overridable on the command line."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from bilevel.errors import one_of
from bilevel.hyperparameters import Hyperparameters, best_preset, load_preset
from bilevel.tasks import Task
from search_spaces import SPACES

#: What proposes a study's configurations, by name: hpbandster's model, or chance; `random` runs
#: all of them at the largest budget.
METHODS = {"bohb": "BOHB", "hyperband": "Hyperband", "random": "random search"}


#: More brackets than a time budget is enough for.
ENDLESS = 1000


@dataclass(frozen=True)
class Profile:
    """Size of a search.

    `time_budget` in seconds ends the search (not a generation half-way); None
    lets it run through all its brackets.
    """

    space: str
    population: int
    smallest_budget: int  # generations of the lowest rung
    largest_budget: int  # generations of the highest rung
    cycle: int | None  # of brackets (`Schedule`); None is Hyperband's
    max_episodes: int  # an agent trains on an SE
    start: str  # of NES, and the candidates it is chosen from (fitted: one for all)
    start_candidates: int
    brackets: int
    time_budget: float | None
    final_agents: int  # trained on the best SE at the end, with fresh seeds


PROFILES = {
    # All three layers, small: to see that it works.
    "smoke": Profile("core", 2, 1, 3, None, 15, "random", 1, 2, None, 4),
    # A good configuration on a laptop, in half an hour. A single generation tells nothing of
    # NES's own hyperparameters: its score is that of the start. Three tell enough that no bracket
    # need begin with nine.
    "local": Profile("core", 8, 3, 9, 1, 1000, "fitted", 4, ENDLESS, 30 * 60.0, 10),
    # The paper's scale (Table "Fixed hyperparameters").
    "paper": Profile("full", 16, 7, 200, None, 1000, "random", 1, 12, None, 10),
}


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


def base_hyperparameters(
    profile: Profile, task: Task, agents: Sequence[str] = ("ddqn",)
) -> Hyperparameters:
    """What a configuration leaves unsaid: the task's preset, in the profile's size."""
    base = load_preset(best_preset(task.id), task.id, SPACES[profile.space], agents)
    return replace(
        base,
        nes=replace(
            base.nes,
            population_size=profile.population,
            generations=profile.largest_budget,
            start=profile.start,
            start_candidates=profile.start_candidates,
        ),
        agents=tuple(replace(hp, max_episodes=profile.max_episodes) for hp in base.agents),
    )
