from dataclasses import asdict, replace

import pytest

from bilevel import InvalidInput
from bilevel.recipes import RECIPES, load_recipe
from cluster.bohb.study.profiles import PROFILES, get_profile, sized
from search_spaces.space import Space


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_changes_only_sizes_and_the_end_of_runs(profile: str, recipe: str) -> None:
    hp = load_recipe(recipe, "CartPole-v0")
    changed = sized(hp, get_profile(profile))
    assert changed.nes.solved_for == (hp.nes.solved_for or 4)
    assert changed.nes.confirming_agents == (hp.nes.confirming_agents or 128)
    sizes = "population_size", "centre_agents", "patient_episodes"
    kept = {name: getattr(hp.nes, name) for name in (*sizes, "solved_for", "confirming_agents")}
    agents = tuple(
        replace(agent, max_episodes=before.max_episodes)
        for agent, before in zip(changed.agents, hp.agents, strict=True)
    )
    assert replace(changed, nes=replace(changed.nes, **kept), agents=agents) == hp


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_sets_nothing_that_its_space_searches(profile: str) -> None:
    size = get_profile(profile)
    hp = load_recipe(size.recipe, "CartPole-v0")
    before, after = asdict(hp.nes), asdict(sized(hp, size).nes)
    changed = {f"nes.{name}" for name in before if before[name] != after[name]}
    assert not changed & Space.of(size.space).searched()


def test_the_paper_profile() -> None:
    """The ranges of step sizes in `full` were searched with the authors' update rule."""
    profile = get_profile("paper")
    assert (profile.space, profile.recipe) == ("full", "authors")
    hp = sized(load_recipe(profile.recipe, "CartPole-v0"), profile)
    assert (hp.nes.update, hp.nes.population_size) == ("authors", 16)


@pytest.mark.parametrize("recipe", ["authors", "paper"])
@pytest.mark.parametrize("task", ["CartPole-v0", "Acrobot-v1"])
def test_the_space_full_fits_the_paper_profile_only(recipe: str, task: str) -> None:
    full, hp = Space.of("full"), load_recipe(recipe, task)
    full.check(sized(hp, get_profile("paper")))
    with pytest.raises(InvalidInput, match=r"init_episodes must be below ddqn\.max_episodes, 15"):
        full.check(sized(hp, get_profile("smoke")))
