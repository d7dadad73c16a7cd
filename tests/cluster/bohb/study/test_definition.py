import json
from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import pytest

from bilevel import InvalidInput
from bilevel.recipes import load_recipe
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.definition import SPACE_FILE, Study
from cluster.bohb.study.journal import Journal, Origin
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
    assert replace(found, recipe="exogenous") == runs.run(0).hp
    assert found.nes.solved_for > 0


def test_the_space_file_contains_all_configurations(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    study.write_space()
    space = CS.ConfigurationSpace.from_json(tmp_path / SPACE_FILE)
    assert space == study.space.build(study.agents)
    for line in Journal(tmp_path).configs:
        CS.Configuration(space, values=line.configuration)  # raises outside the space


def test_the_first_configuration_is_the_recipe_within_the_space(tmp_path: Path) -> None:
    study = replace(new_study(tmp_path), prior="recipe", base=load_recipe("paper", "CartPole-v0"))
    recipe, first = study.recipe_values, study.prior_configuration()
    assert first is not None
    assert (recipe["nes.std_dev"], first["nes.std_dev"]) == (0.0124, 0.03)
    assert first["nes.population_size"] == recipe["nes.population_size"]
    assert replace(study, prior="none").prior_configuration() is None
    job = BracketSearch(study, Journal(study.folder), 1).next_job()
    assert job is not None
    assert (job.configuration, job.origin) == (first, Origin.RECIPE)


def test_a_recipe_that_the_space_forbids_is_refused(tmp_path: Path) -> None:
    study = new_study(tmp_path / "study")
    dimension = CS.Integer("nes.population_size", (2, 48))
    space = CS.ConfigurationSpace(space=[dimension])
    space.add(CS.ForbiddenEqualsClause(dimension, study.base.nes.population_size))
    mine = replace(study, prior="recipe", space=Space("mine", dict(space.to_serialized_dict())))
    with pytest.raises(InvalidInput, match="the search space forbids"):
        mine.prior_configuration()
