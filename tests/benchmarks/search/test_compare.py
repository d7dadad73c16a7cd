from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import pytest

from benchmarks.search import compare
from benchmarks.search.compare import SPACE, brackets_of, fresh_run
from bilevel.hyperparameters import Hyperparameters, recipe_text
from cluster.bohb.brackets import core_seconds_to_run
from cluster.bohb.profiles import METHODS
from search_spaces import search_space


def test_the_space_is_core_without_the_length_of_episodes() -> None:
    core, space = search_space("core"), CS.ConfigurationSpace.from_json(SPACE)
    assert set(core) - set(space) == {"se.step_limit", "se.spread"}
    assert dict(space) == {name: core[name] for name in space}


def test_all_methods_have_the_same_core_time() -> None:
    for method in METHODS:
        brackets, schedule = brackets_of(method, 1890)
        spent = core_seconds_to_run(schedule.brackets(brackets))
        assert abs(spent - 1890) <= core_seconds_to_run(schedule.brackets(1)) / 2


def test_a_fresh_run_is_a_function_of_recipe_and_number(
    tmp_path: Path, small_hp: Hyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compare, "FINAL_AGENTS", 1)  # of any size
    nes = replace(small_hp.nes, generations=1)
    recipe = tmp_path / "small.toml"
    recipe.write_text(recipe_text(replace(small_hp, nes=nes), "Small."))
    one, again, other = (fresh_run("CartPole-v0", str(recipe), number) for number in (0, 0, 1))
    assert one == again
    assert one["score"] != other["score"]
    assert other["seed"] == one["seed"] + 1
    assert not one["confirmed"]
    assert one["solved"] == (one["score"] >= 195)
    assert one["generations"] == 1
