import json
from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import pytest

from bilevel import InvalidInput
from bilevel.recipes import load_recipe
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.definition import SPACE_FILE, Study
from cluster.bohb.study.journal import Journal
from search_spaces.bohb import search_space
from search_spaces.space import Space
from tests.studies import make_study, new_study


@pytest.mark.parametrize("space", [Space("core"), Space("mine", {"hyperparameters": []})])
def test_a_study_is_read_from_its_folder(space: Space, tmp_path: Path) -> None:
    make_study(tmp_path, brackets=1)
    schedule = Schedule((1, 3, 9), 2)
    study = replace(new_study(tmp_path), space=space, seed=3, method="hyperband", schedule=schedule)
    stored = json.loads((tmp_path / "settings.json").read_text())
    (tmp_path / "settings.json").write_text(json.dumps({**stored, **study.settings()}))
    assert Study.read(tmp_path) == study


def test_the_exported_recipe_has_the_hyperparameters_of_the_runs(tmp_path: Path) -> None:
    study = make_study(tmp_path / "study")
    line = Journal(study.folder).configs[0]
    path = tmp_path / "found.toml"
    path.write_text(study.recipe_text(line.id, line.configuration))
    found = load_recipe(str(path), study.task)
    runs = ConfigurationRuns(study, line.id, line.configuration)
    assert replace(found, recipe="default") == runs.run(0).hp
    assert found.nes.solved_for > 0


def test_the_space_file_contains_all_configurations(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    study.write_space()
    stored = json.loads((tmp_path / SPACE_FILE).read_text())
    space = CS.ConfigurationSpace.from_serialized_dict(stored)
    assert space == study.stored_space() == study.space.build(study.agents)
    for line in Journal(tmp_path).configs:
        CS.Configuration(space, values=line.configuration)  # raises outside the space


def test_a_study_keeps_the_ranges_that_it_started_with(tmp_path: Path) -> None:
    """Another version may have other ranges for the space of that name."""
    study = make_study(tmp_path)
    study.write_space()
    study.write_space()  # by the same version
    other = search_space("core").to_serialized_dict()
    other["hyperparameters"][0]["upper"] *= 2
    (tmp_path / SPACE_FILE).write_text(json.dumps(other))
    with pytest.raises(InvalidInput, match="started with other ranges of the search space 'core'"):
        study.write_space()
    assert json.loads((tmp_path / SPACE_FILE).read_text()) == other


def test_a_recipe_without_a_step_limit_has_the_tasks(tmp_path: Path) -> None:
    paper = replace(new_study(tmp_path), base=load_recipe("paper", "CartPole-v0"))
    assert paper.base.se.step_limit == 0
    assert paper.of_recipe["se.step_limit"] == paper.task.step_limit
