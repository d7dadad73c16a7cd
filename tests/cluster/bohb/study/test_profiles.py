"""Recipes in the size of a profile."""

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from bilevel import InvalidInput
from bilevel.hyperparameters import RECIPES, load_recipe
from cluster.bohb.study.profiles import PROFILES, get_profile, sized
from cluster.cli.options import RunOptions
from search_spaces.space import Space


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_leaves_the_recipe_otherwise_alone(profile: str, recipe: str) -> None:
    hp, size = load_recipe(recipe, "CartPole-v0"), get_profile(profile)
    made = sized(hp, size)
    changed = {
        "solved_for",
        "confirming_agents",
        "population_size",
        "centre_agents",
        "patient_episodes",
    }
    before = {name: getattr(hp.nes, name) for name in changed}
    agents = tuple(
        replace(one, max_episodes=was.max_episodes)
        for one, was in zip(made.agents, hp.agents, strict=True)
    )
    assert replace(made, nes=replace(made.nes, **before), agents=agents) == hp


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.parametrize("profile", PROFILES)
def test_runs_of_a_search_end_once_an_se_is_confirmed(profile: str, recipe: str) -> None:
    """Those of a recipe that never ends early, too."""
    hp = load_recipe(recipe, "CartPole-v0")
    nes = sized(hp, get_profile(profile)).nes
    assert nes.solved_for == (hp.nes.solved_for or 4)
    assert nes.confirming_agents == (hp.nes.confirming_agents or 128)


def test_the_population_is_the_profiles_if_it_has_any() -> None:
    for name in PROFILES:
        hp = load_recipe("default", "CartPole-v0")
        own = 16 if name == "paper" else hp.nes.population_size
        assert sized(hp, get_profile(name)).nes.population_size == own


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_sets_nothing_that_its_space_searches(profile: str) -> None:
    size = get_profile(profile)
    hp = load_recipe(size.recipe, "CartPole-v0")
    before, after = asdict(hp.nes), asdict(sized(hp, size).nes)
    changed = {f"nes.{name}" for name in before if before[name] != after[name]}
    assert not changed & Space.of(size.space).searched()


def test_what_a_user_asks_for_goes_before_the_profile(tmp_path: Path) -> None:
    chosen = ("nes.start_candidates", 3)
    options = RunOptions(
        "CartPole-v0", 0, None, (), None, None, tmp_path, None, None, 5, settings=(chosen,)
    )
    smoke = get_profile("smoke")
    nes = options.the_hyperparameters(
        options.the_task(), "default", lambda hp: sized(hp, smoke)
    ).nes
    assert (nes.population_size, nes.start_candidates, nes.centre_agents) == (5, 3, 2)


def test_the_papers_space_is_searched_under_the_rule_of_its_ranges() -> None:
    """Its step sizes are of the authors' code; Algorithm 1 divides the step by n_p sigma."""
    profile = get_profile("paper")
    assert (profile.space, profile.recipe) == ("full", "authors")
    assert load_recipe(profile.recipe, "CartPole-v0").nes.update == "authors"


@pytest.mark.parametrize("recipe", ["authors", "paper"])
@pytest.mark.parametrize("task", ["CartPole-v0", "Acrobot-v1"])
def test_the_papers_space_fits_its_recipes(recipe: str, task: str) -> None:
    """But not where training is cut to fewer episodes than it begins with."""
    full, hp = Space.of("full"), load_recipe(recipe, task)
    full.check(sized(hp, get_profile("paper")))
    with pytest.raises(InvalidInput, match=r"init_episodes must be below ddqn\.max_episodes, 15"):
        full.check(sized(hp, get_profile("smoke")))
