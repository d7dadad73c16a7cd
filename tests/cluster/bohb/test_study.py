"""What a study hands over."""

import json
from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import pytest

from bilevel import InvalidInput
from bilevel.hyperparameters import load_recipe
from bilevel.tasks import get_task
from cluster.bohb.journal import Journal
from cluster.bohb.study import RECIPE_FILE, SPACE_FILE, Study
from cluster.bohb.view import study_progress
from cluster.cli.options import RunOptions
from search_spaces.bohb import search_space
from search_spaces.space import Space
from tests.commands import run_bilevel
from tests.studies import make_study, new_study


def test_a_configuration_is_handed_over_as_the_recipe_that_its_runs_had(tmp_path: Path) -> None:
    make_study(tmp_path / "study")
    study, line = new_study(tmp_path / "study"), Journal(tmp_path / "study").configs[0]
    path = tmp_path / "found.toml"
    path.write_text(study.recipe_text(line.id, line.configuration))
    found = load_recipe(str(path), study.task)
    assert replace(found, recipe="default") == study.run(line.id, line.configuration, 0).hp
    assert found.nes.solved_for > 0


def test_the_name_of_a_study_stands_for_its_recipe(tmp_path: Path) -> None:
    made = make_study(tmp_path / "CartPole-v0" / "mine")
    line = Journal(made.folder).configs[-1]
    (made.folder / RECIPE_FILE).write_text(made.recipe_text(line.id, line.configuration))
    options = RunOptions(
        "CartPole-v0", 0, None, (), None, None, tmp_path, None, None, recipe="mine"
    )
    hp = options.the_hyperparameters(made.task)
    assert hp.recipe == "mine"
    assert replace(hp, recipe="default") == made.run(line.id, line.configuration, 0).hp
    larger = replace(options, population=77).the_hyperparameters(made.task)
    assert larger.nes == replace(hp.nes, population_size=77)


def test_a_study_without_an_incumbent_has_no_recipe(tmp_path: Path) -> None:
    make_study(tmp_path / "CartPole-v0" / "mine")
    arguments = ("nes", "CartPole-v0", "--recipe", "mine", "--home", str(tmp_path))
    result = run_bilevel(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert (
        "'mine' on CartPole-v0 has found no recipe: give a study that has run to its end"
        in result.stderr
    )


def test_an_unknown_recipe_is_answered_with_those_that_studies_have_found(tmp_path: Path) -> None:
    make_study(tmp_path / "CartPole-v0" / "mine")
    make_study(tmp_path / "CartPole-v0" / "found")
    (tmp_path / "CartPole-v0" / "found" / RECIPE_FILE).touch()
    arguments = ("--recipe", "x", "--home", str(tmp_path))
    result = run_bilevel("nes", "CartPole-v0", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert "studies on CartPole-v0 that have found one (found)" in " ".join(result.stderr.split())
    result = run_bilevel("bohb", "Acrobot-v1", *arguments, cwd=tmp_path)
    assert "studies on Acrobot-v1 that have found one (none yet)" in " ".join(result.stderr.split())


def test_a_study_keeps_the_ranges_that_it_was_begun_with(tmp_path: Path) -> None:
    """A later version's space of the same name may have others."""
    study = make_study(tmp_path)
    study.write_space()
    study.write_space()  # by the same version
    other = search_space("core").to_serialized_dict()
    other["hyperparameters"][0]["upper"] *= 2
    (tmp_path / SPACE_FILE).write_text(json.dumps(other))
    with pytest.raises(InvalidInput, match="begun with other ranges of the search space 'core'"):
        study.write_space()
    assert json.loads((tmp_path / SPACE_FILE).read_text()) == other


def test_a_recipe_outside_of_the_space_is_moved_and_told() -> None:
    task = get_task("CartPole-v0")
    recipe = load_recipe("default", task.id)
    inside = replace(new_study(Path("study")), prior="recipe", base=recipe)
    assert inside.moved == {}
    assert inside.prior_configuration is not None
    paper = replace(inside, base=load_recipe("paper", task.id))
    assert paper.moved["nes.std_dev"] == (0.0124, 0.03)
    # 0 stands for the task's own limit, which is in the space.
    assert "se.step_limit" not in paper.moved
    assert paper.prior_configuration is not None
    assert paper.prior_configuration["se.step_limit"] == task.step_limit
    assert replace(paper, prior="none").moved == {}


def test_a_recipe_that_the_space_forbids_is_told_before_the_search(tmp_path: Path) -> None:
    study = new_study(tmp_path / "study")
    dimension, base = CS.Integer("nes.population_size", (2, 48)), study.base.nes.population_size
    space = CS.ConfigurationSpace(space=[dimension])
    space.add(CS.ForbiddenEqualsClause(dimension, base))
    space.to_json(tmp_path / "mine.json")
    mine = replace(study, space=Space.of(str(tmp_path / "mine.json")))
    mine.check_prior()
    with pytest.raises(
        InvalidInput, match=r"would begin with its recipe \(not with --prior none\)"
    ):
        replace(mine, prior="recipe").check_prior()


def test_progress_of_a_study_whose_agent_is_not_known_here(tmp_path: Path) -> None:
    make_study(tmp_path)
    settings = json.loads((tmp_path / "settings.json").read_text())
    settings["base"]["agents"] = {"of-another-file": {}}
    (tmp_path / "settings.json").write_text(json.dumps(settings))
    with pytest.raises(InvalidInput, match="unknown agent 'of-another-file'"):
        Study.read(tmp_path)
    assert study_progress(tmp_path, 2).done == "6/6 results"
