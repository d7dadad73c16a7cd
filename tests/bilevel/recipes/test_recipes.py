"""Every recipe builds a run, and recipes extend each other."""

from dataclasses import replace
from pathlib import Path

import pytest

from bilevel import NES, get_task
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import default_agents
from bilevel.recipes import BUILT_IN_AGENTS, RECIPES, load_recipe, recipe_text, usual_agents
from tests.conftest import restored

TASKS = ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"]


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    return tmp_path / "mine.toml"


@pytest.mark.parametrize("name", RECIPES)
@pytest.mark.parametrize("task_id", TASKS)
def test_every_recipe_builds(name: str, task_id: str) -> None:
    hp = load_recipe(name, task_id, BUILT_IN_AGENTS)
    NES(get_task(task_id), hp)
    assert restored(hp.to_dict()) == hp


def test_usual_agents_depend_on_the_length_of_episodes() -> None:
    task = get_task("Pendulum-v1")
    assert usual_agents(task, one_step=True) == load_recipe("default", task).agents
    assert usual_agents(task, one_step=False) == default_agents(("td3",))
    chosen = usual_agents(get_task("CartPole-v0"), one_step=True, names=("ppo", "ddqn"))
    assert [agent.agent for agent in chosen] == ["ppo", "ddqn"]


def test_paper_has_the_optimized_hyperparameters() -> None:
    cartpole, acrobot = (load_recipe("paper", task) for task in TASKS[:2])
    assert (cartpole.nes.step_size, cartpole.nes.std_dev) == (0.148, 0.0124)
    assert (cartpole.se.hidden_size, cartpole.agents[0].batch_size) == (83, 199)  # type: ignore[attr-defined]
    assert (acrobot.nes.step_size, acrobot.nes.std_dev) == (0.727, 0.0114)
    assert (acrobot.se.hidden_size, acrobot.se.activation) == (167, "prelu")
    for hp in (cartpole, acrobot):
        assert (hp.nes.update, hp.nes.score_transform) == ("paper", "better-average")
        assert (hp.nes.population_size, hp.nes.generations) == (16, 200)
        assert (hp.nes.start_candidates, hp.nes.solved_for, hp.se.step_limit) == (1, 0, 0)


def test_authors_differ_from_paper_in_rule_transform_and_ties() -> None:
    transforms = ("nes-unnormalized", "nes-unnormalized", "better-average-sum")
    for task, transform in zip(TASKS, transforms, strict=True):
        paper, authors = load_recipe("paper", task), load_recipe("authors", task)
        assert (authors.nes.update, authors.nes.ties) == ("authors", "order")
        assert authors.nes.score_transform == transform
        own = {name: getattr(paper.nes, name) for name in ("update", "ties", "score_transform")}
        assert replace(authors, nes=replace(authors.nes, **own), recipe="paper") == paper


def test_a_file_contains_only_its_differences(recipe: Path) -> None:
    recipe.write_text(
        'extends = "paper"\n[nes]\nstd_dev = 0.3\n[tasks.Acrobot-v1.nes]\nstd_dev = 1'
    )
    for task, std_dev in (("CartPole-v0", 0.3), ("Acrobot-v1", 1.0)):
        paper = load_recipe("paper", task)
        changed = replace(paper, nes=replace(paper.nes, std_dev=std_dev), recipe="mine")
        assert load_recipe(recipe, task) == changed
    child = recipe.with_name("child.toml")
    child.write_text(f'extends = "{recipe}"\nagents = ["td3"]')
    loaded = load_recipe(child, "CartPole-v0")
    assert (loaded.nes.std_dev, loaded.agents[0].agent) == (0.3, "td3")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("not toml", "cannot read the recipe"),
        ('agents = ["ddqn"]', r"^recipe '.*mine.toml': 'nes.update' is missing"),
        ('extends = "default"\nnes = 3', "nes"),
        ('extends = "default"\n[nse]\nstd_dev = 1', "unknown agent 'nse'"),
        ('extends = "default"\nagents = ["dqn"]', "unknown agent 'dqn': allowed are ddqn"),
        ('extends = "default"\nvary_agent = "some"', "vary_agent: must be 'no', 'small'"),
        ('extends = "default"\n[td3]\npolicy_delay = 0', r"^recipe .*: td3\.policy_delay: must be"),
        ('extends = "default"\n[td3]\ndelay = 2', "unknown 'td3.delay'"),
        ('extends = "mine"', "unknown recipe 'mine': allowed are default, exogenous"),
        ('extends = "missing.toml"', "cannot read the recipe 'missing.toml'"),
        ('extends = "{path}"', "extends itself"),
    ],
)
def test_invalid_files(content: str, message: str, recipe: Path) -> None:
    recipe.write_text(content.replace("{path}", str(recipe)))
    with pytest.raises(InvalidInput, match=message):
        load_recipe(recipe, "CartPole-v0")


@pytest.mark.parametrize("name", RECIPES)
def test_recipe_text_is_complete(name: str, recipe: Path) -> None:
    """It extends nothing, and gives the same hyperparameters on every task."""
    hp = load_recipe(name, "CartPole-v0", ("ddqn", "td3"))
    recipe.write_text(recipe_text(hp, "Written by a test,\nnes = in two lines"))
    assert load_recipe(recipe, "Acrobot-v1") == replace(hp, recipe="mine")
