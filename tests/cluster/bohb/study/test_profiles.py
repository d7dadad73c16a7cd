from dataclasses import asdict, replace

import ConfigSpace as CS
import pytest

from bilevel.errors import InvalidInput
from bilevel.recipes import RECIPES, load_recipe
from bilevel.tasks import get_task
from cluster.bohb.study.profiles import PROFILES, searched_space, sized
from search_spaces.space import Space

TASK = get_task("CartPole-v0")
BASE = load_recipe("default", TASK)
CORE, FULL = Space.of("core"), Space.of("full")


def mine(*dimensions: CS.hyperparameters.Hyperparameter) -> Space:  # type: ignore[type-arg]
    space = CS.ConfigurationSpace(space=list(dimensions))
    return Space("mine", dict(space.to_serialized_dict()))


def test_hyperparameters_with_an_effect_can_be_set() -> None:
    assert searched_space(CORE, TASK, BASE, {"nes.generations": 9}) == CORE
    assert searched_space(CORE, TASK, BASE, {"nes.std_dev": 0.2}, "recipe") == CORE


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nes.solved_for", "nes.solved_for cannot be set in a search"),
        ("nes.std_dev", "setting it to 1 has no effect: leave it out, or use --prior recipe"),
        ("nes.averaging", "nes.averaging is searched in the space 'core'"),  # as one minus it
    ],
)
def test_hyperparameters_without_an_effect_are_refused(name: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        searched_space(CORE, TASK, BASE, {name: 1})


@pytest.mark.parametrize(
    ("dimension", "message"),
    [
        (CS.Float("nes.sigma", (0.1, 0.4)), "unknown hyperparameter 'nes.sigma': allowed are nes."),
        (CS.Float("td3.learning_rate", (0.1, 0.4)), "unknown hyperparameter 'td3.learning_rate'"),
        (
            CS.Float("nes.std_dev", (0.1, 99.0)),
            r"nes\.std_dev: must be less than or equal to 10",
        ),
        (CS.Integer("nes.solved_for", (1, 9)), "nes.solved_for cannot be set in a search"),
        (
            CS.Categorical("se.activation", ("tanh", "sine")),
            r"se\.activation: must be 'tanh'.* got 'sine'",
        ),
        (CS.Constant("se.activation", "relu"), "se.family"),  # exogenous SEs need tanh
    ],
)
def test_spaces_that_nes_rejects_are_refused(
    dimension: CS.hyperparameters.Hyperparameter,  # type: ignore[type-arg]
    message: str,
) -> None:
    with pytest.raises(InvalidInput, match=message):
        searched_space(mine(dimension), TASK, BASE)


def test_forbidden_values_are_not_tried() -> None:
    population = CS.Integer("nes.population_size", (0, 3))
    space = CS.ConfigurationSpace(space=[population])
    space.add(CS.ForbiddenEqualsClause(population, 0))
    searched_space(Space("mine", dict(space.to_serialized_dict())), TASK, BASE)


@pytest.mark.parametrize("recipe", ["authors", "paper"])
def test_the_space_full_needs_constant_agents_and_the_paper_profile(recipe: str) -> None:
    base = sized(load_recipe(recipe, TASK), PROFILES["paper"])
    assert searched_space(FULL, TASK, base) == FULL
    with pytest.raises(InvalidInput, match=r"for each agent \(--vary-hp all"):
        searched_space(FULL, TASK, replace(base, vary_agent="all"))
    with pytest.raises(InvalidInput, match=r"init_episodes must be below ddqn\.max_.*, 15"):
        searched_space(FULL, TASK, sized(base, PROFILES["smoke"]))


@pytest.mark.parametrize(
    ("recipe", "task_id", "unused"),
    [
        ("default", "CartPole-v0", set()),
        ("paper", "CartPole-v0", {"se.spread"}),
        ("default", "Pendulum-v1", set()),
    ],
)
def test_core_without_unused_dimensions(recipe: str, task_id: str, unused: set[str]) -> None:
    task = get_task(task_id)
    adapted = searched_space(CORE, task, load_recipe(recipe, task)).build()
    assert set(CORE.build()) - set(adapted) == unused


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_changes_only_sizes_and_the_end_of_runs(profile: str, recipe: str) -> None:
    hp = load_recipe(recipe, "CartPole-v0")
    changed = sized(hp, PROFILES[profile])
    assert changed.nes.solved_for == (hp.nes.solved_for or 4)
    assert changed.nes.confirming_agents == (hp.nes.confirming_agents or 128)
    sizes = "population_size", "centre_agents", "patient_episodes"
    kept = {name: getattr(hp.nes, name) for name in (*sizes, "solved_for", "confirming_agents")}
    agents = tuple(
        replace(agent, init_episodes=before.init_episodes, max_episodes=before.max_episodes)
        for agent, before in zip(changed.agents, hp.agents, strict=True)
    )
    assert replace(changed, nes=replace(changed.nes, **kept), agents=agents) == hp


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_sets_nothing_that_its_space_searches(profile: str) -> None:
    size = PROFILES[profile]
    hp = load_recipe(size.recipe, "CartPole-v0")
    before, after = asdict(hp.nes), asdict(sized(hp, size).nes)
    changed = {f"nes.{name}" for name in before if before[name] != after[name]}
    assert not changed & Space.of(size.space).searched()


def test_training_in_episodes_of_one_step_is_longer() -> None:
    """Agents learn for a while after their initial episodes."""
    for recipe, episodes in (("exogenous", 15), ("default", 300)):
        agent, *_ = sized(load_recipe(recipe, TASK), PROFILES["smoke"]).agents
        assert agent.max_episodes == episodes
        assert 0 < agent.init_episodes <= episodes / 10
