"""Search spaces from users' files."""

from pathlib import Path
from typing import Any

import ConfigSpace as CS
import pytest

from bilevel import InvalidInput
from bilevel.nes import NES
from bilevel.recipes import load_recipe
from bilevel.tasks import get_task
from search_spaces.bohb import search_space
from search_spaces.space import Space

BASE = load_recipe("default", "CartPole-v0")


def written(path: Path, *dimensions: Any) -> Space:
    """A space that was written to a file and read back."""
    space = CS.ConfigurationSpace(space=list(dimensions))
    space.to_json(path) if path.suffix == ".json" else space.to_yaml(path)
    return Space.of(str(path))


@pytest.mark.parametrize("name", ["mine.json", "mine.yaml"])
def test_files_of_configspace_are_read(name: str, tmp_path: Path) -> None:
    space = written(tmp_path / name, CS.Float("nes.std_dev", (0.1, 0.4), log=True))
    space.check(BASE)
    assert space.name == "mine"
    assert list(space.build()) == ["nes.std_dev"]
    assert space.build() == Space(space.name, space.content).build()
    first, second = (dict(space.build(seed=3).sample_configuration()) for _ in range(2))
    assert first == second


@pytest.mark.parametrize(
    ("dimension", "message"),
    [
        (CS.Float("nes.sigma", (0.1, 0.4)), "unknown hyperparameter 'nes.sigma': allowed are nes."),
        (CS.Float("td3.learning_rate", (0.1, 0.4)), "td3.learning_rate is of an agent that"),
        (CS.Float("nes.std_dev", (0.1, 99.0)), "nes.std_dev: must be less than or equal to 10"),
        (CS.Integer("nes.generations", (1, 9)), "nes.generations is set by the search itself"),
        (CS.Categorical("se.activation", ("tanh", "sine")), "se.activation: must be 'tanh', "),
        (CS.OrdinalHyperparameter("se.hidden_size", [8, 16, 32]), "has ordinal hyperparameters"),
        (CS.Constant("se.activation", "relu"), "se.family"),  # exogenous SEs need tanh
    ],
)
def test_unsuitable_spaces_are_refused(dimension: Any, message: str, tmp_path: Path) -> None:
    task = get_task("CartPole-v0")
    with pytest.raises(InvalidInput, match=r"^search space 'mine'.*") as caught:
        written(tmp_path / "mine.json", dimension).check(
            BASE, ("nes.generations",), lambda hp: NES(task, hp)
        )
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_forbidden_values_are_not_tried(tmp_path: Path) -> None:
    population = CS.Integer("nes.population_size", (0, 3))
    space = CS.ConfigurationSpace(space=[population])
    space.add(CS.ForbiddenEqualsClause(population, 0))
    Space("mine", dict(space.to_serialized_dict())).check(BASE)


def test_searched_hyperparameters(tmp_path: Path) -> None:
    core = Space.of("core").searched()
    assert {"nes.averaging", "se.spread"} < core  # averaging as one minus the value
    assert core.isdisjoint({"nes.1-averaging", "nes.update", "ddqn.discount"})
    assert "td3.discount" in Space.of("full").searched(("td3",))


def test_conditional_hyperparameters_are_not_always_searched() -> None:
    ties, std_dev = CS.Categorical("nes.ties", ("mean", "order")), CS.Float("nes.std_dev", (0.1, 1))
    space = CS.ConfigurationSpace(space=[ties, std_dev])
    space.add(CS.EqualsCondition(std_dev, ties, "mean"))
    assert Space("mine", dict(space.to_serialized_dict())).searched() == {"nes.ties"}


@pytest.mark.parametrize("ending", ["json", "yaml"])
@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        "nonsense: [",
        '{"hyperparameters": [{}]}',
        "[" * 9999,
        "meta: {started: 2026-01-01}\nhyperparameters: []\n",  # JSON has no dates
    ],
    ids=range(7),
)
def test_files_without_a_space_are_refused(text: str, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"mine.{ending}"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=r"^search space [^\n]+$"):
        Space.of(str(path))


def test_built_in_spaces_by_name() -> None:
    assert Space.of("core").build(("td3",)) == search_space("core", ("td3",))
    with pytest.raises(InvalidInput, match="unknown search space 'x': allowed are full, core"):
        Space.of("x")
