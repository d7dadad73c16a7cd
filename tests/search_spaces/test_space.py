"""Search spaces from users' files."""

from pathlib import Path
from typing import Any

import ConfigSpace as CS
import pytest

from bilevel import InvalidInput
from search_spaces.bohb import search_space
from search_spaces.space import Space


def written(path: Path, *dimensions: Any) -> Space:
    """A space that was written to a file and read back."""
    CS.ConfigurationSpace(space=list(dimensions)).to_json(path)
    return Space.of(str(path))


def test_files_of_configspace_are_read(tmp_path: Path) -> None:
    space = written(tmp_path / "mine.json", CS.Float("nes.std_dev", (0.1, 0.4), log=True))
    assert space.name == "mine"
    assert list(space.build()) == ["nes.std_dev"]
    assert space.build() == Space(space.name, space.content).build()
    first, second = (dict(space.build(seed=3).sample_configuration()) for _ in range(2))
    assert first == second


@pytest.mark.parametrize("dimensions", [[], [CS.OrdinalHyperparameter("se.hidden_size", [8, 16])]])
def test_spaces_that_the_model_cannot_use_are_refused(
    dimensions: list[Any], tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match="must contain only floats, integers, categories"):
        written(tmp_path / "mine.json", *dimensions)


def test_searched_hyperparameters() -> None:
    core = Space.of("core").searched()
    assert {"nes.averaging", "se.spread"} < core  # averaging as one minus the value
    assert core.isdisjoint({"nes.1-averaging", "nes.update", "ddqn.discount"})
    assert "td3.discount" in Space.of("full").searched(("td3",))


def test_conditional_hyperparameters_are_not_always_searched() -> None:
    ties, std_dev = CS.Categorical("nes.ties", ("mean", "order")), CS.Float("nes.std_dev", (0.1, 1))
    space = CS.ConfigurationSpace(space=[ties, std_dev])
    space.add(CS.EqualsCondition(std_dev, ties, "mean"))
    assert Space("mine", dict(space.to_serialized_dict())).searched() == {"nes.ties"}


@pytest.mark.parametrize("text", ["", "[]", "{}", "[1", '{"hyperparameters": [{}]}', "[" * 9999])
def test_files_without_a_space_are_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=r"^(cannot read the )?search space [^\n]+$"):
        Space.of(str(path))


def test_built_in_spaces_by_name() -> None:
    assert Space.of("core").build(("td3",)) == search_space("core", ("td3",))
    with pytest.raises(InvalidInput, match="unknown search space 'x': allowed are full, core"):
        Space.of("x")
