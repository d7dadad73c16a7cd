"""Every shipped recipe is complete and matches its name."""

import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

from bilevel.errors import InvalidInput
from bilevel.hyperparameters import (
    RECIPES,
    agent_names,
    load_recipe,
    recipe_text,
)
from bilevel.nes import NES
from bilevel.tasks import get_task
from tests.conftest import restored

FILES = sorted(
    path.name
    for path in files("bilevel.hyperparameters.recipes").iterdir()
    if path.name.endswith(".toml")
)
TASKS = ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"]


def test_each_recipe_has_a_file_for_both_tasks_and_for_any_other() -> None:
    endings = ("-Acrobot-v1.toml", "-CartPole-v0.toml", ".toml")
    assert sorted(f"{name}{ending}" for name in RECIPES for ending in endings) == FILES


@pytest.mark.parametrize("name", RECIPES)
@pytest.mark.parametrize("task_id", TASKS)
def test_a_run_can_be_built_from_it(name: str, task_id: str) -> None:
    hp = load_recipe(name, task_id, agent_names()[:3])
    NES(get_task(task_id), hp)
    assert restored(hp.to_dict()) == hp


@pytest.mark.parametrize("file", FILES)
def test_a_file_is_complete(file: str, tmp_path: Path) -> None:
    """Each missing line is refused, and the message names the missing field."""
    lines = files("bilevel.hyperparameters.recipes").joinpath(file).read_text().splitlines()
    section = ""
    for number, line in enumerate(lines):
        section = line.strip("[]") if line.startswith("[") else section
        key = line.split(" = ")[0]
        if section not in ("nes", "se", "ddqn") or " = " not in line:
            continue
        path = tmp_path / "cut.toml"
        path.write_text("\n".join(lines[:number] + lines[number + 1 :]))
        with pytest.raises(InvalidInput, match=key):
            load_recipe(str(path), "CartPole-v0")


def test_paper_holds_the_optimized_hyperparameters() -> None:
    cartpole, acrobot = (load_recipe("paper", task) for task in TASKS[:2])
    assert (cartpole.nes.step_size, cartpole.nes.std_dev) == (0.148, 0.0124)
    assert (cartpole.se.hidden_size, cartpole.agents[0].batch_size) == (83, 199)  # type: ignore[attr-defined]
    assert (acrobot.nes.step_size, acrobot.nes.std_dev) == (0.727, 0.0114)
    assert (acrobot.se.hidden_size, acrobot.se.activation) == (167, "prelu")
    for hp in (cartpole, acrobot):
        assert (hp.nes.update, hp.nes.score_transform) == ("paper", "better-average")
        assert (hp.nes.population_size, hp.nes.generations) == (16, 200)
        assert (hp.nes.start_candidates, hp.nes.solved_for, hp.se.step_limit) == (1, 0, 0)


def test_authors_differ_in_rule_transform_and_ties_alone() -> None:
    for task, transform in zip(
        TASKS, ("nes-unnormalized",) * 2 + ("better-average-sum",), strict=True
    ):
        paper, authors = load_recipe("paper", task), load_recipe("authors", task)
        assert (authors.nes.update, authors.nes.ties) == ("authors", "order")
        assert authors.nes.score_transform == transform
        own = {name: getattr(paper.nes, name) for name in ("update", "ties", "score_transform")}
        assert replace(authors, nes=replace(authors.nes, **own), recipe="paper") == paper


def test_only_distilled_learns_from_more_than_scores() -> None:
    for name in RECIPES:
        for task in TASKS:
            assert (load_recipe(name, task).nes.start == "distilled") is (name == "distilled")


def test_a_recipe_of_ones_own(tmp_path: Path) -> None:
    text = files("bilevel.hyperparameters.recipes").joinpath("default.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("std_dev = 0.2", "std_dev = 0.3"))
    assert load_recipe(str(path), "CartPole-v0").nes.std_dev == 0.3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("not toml", "not a TOML file"),
        ("[nes]", "'agents' is missing"),
        ('agents = ["ddqn"]\nvary_agent = "no"\nnes = 3\nse = 4', "recipe"),
    ],
)
def test_a_file_that_is_no_recipe(content: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.toml"
    path.write_text(content)
    with pytest.raises(InvalidInput, match=message):
        load_recipe(str(path), "CartPole-v0")


@pytest.mark.parametrize("section", ["nes", "ddqn"])
def test_a_wrong_value_is_told_with_its_file(section: str, tmp_path: Path) -> None:
    text = files("bilevel.hyperparameters.recipes").joinpath("default.toml").read_text()
    name = {"nes": "population_size", "ddqn": "batch_size"}[section]
    path = tmp_path / "mine.toml"
    path.write_text(re.sub(rf"^{name} = .*$", f"{name} = 0", text, flags=re.MULTILINE))
    with pytest.raises(InvalidInput, match=rf"^recipe '.*mine.toml': .*{section}\.{name} must be"):
        load_recipe(str(path), "CartPole-v0")


def test_sections_of_agents_that_are_not_drawn_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    text = recipe_text(load_recipe("default", "CartPole-v0", ("ddqn", "td3")), "Mine.")
    text = text.replace('agents = ["ddqn", "td3"]', 'agents = ["ddqn"]')
    for old, new, told in (
        ("policy_delay = 2", "policy_delay = 0", r"td3\.policy_delay must be"),
        ("policy_delay = 2", "", "td3: 'policy_delay' is missing"),
        ("policy_delay = 2", "policy_delay = 2\ndelay = 2", "delay"),
    ):
        assert old in text
        path.write_text(text.replace(old, new))
        with pytest.raises(InvalidInput, match=rf"^recipe '.*mine.toml'.*{told}"):
            load_recipe(str(path), "CartPole-v0")


def test_an_unknown_recipe() -> None:
    with pytest.raises(InvalidInput, match="unknown recipe 'tuned': allowed are default, paper"):
        load_recipe("tuned", "CartPole-v0")
    with pytest.raises(InvalidInput, match="cannot read the recipe"):
        load_recipe("missing.toml", "CartPole-v0")


@pytest.mark.parametrize("name", RECIPES)
def test_what_is_written_as_a_recipe_is_read_again(name: str, tmp_path: Path) -> None:
    hp = load_recipe(name, "CartPole-v0", ("ddqn", "td3"))
    path = tmp_path / f"{name}.toml"
    path.write_text(recipe_text(hp, "Written by a test,\nnes = in two lines"))
    assert load_recipe(str(path), "Acrobot-v1") == hp


def test_a_recipe_without_an_agent_says_so(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(recipe_text(load_recipe("default", "CartPole-v0"), "Mine."))
    with pytest.raises(InvalidInput, match=r"has no section \[td3\], for the agent of that name"):
        load_recipe(str(path), "CartPole-v0", ["ddqn", "td3"])
