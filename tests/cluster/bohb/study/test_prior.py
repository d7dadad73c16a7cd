"""Searches that start with a recipe."""

from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import pytest

from bilevel import InvalidInput
from bilevel.recipes import load_recipe
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.study.journal import Journal, Origin
from search_spaces.space import Space
from tests.studies import new_study


def test_the_first_configuration_is_the_recipe_within_the_space(tmp_path: Path) -> None:
    study = replace(new_study(tmp_path), prior="recipe", base=load_recipe("paper", "CartPole-v0"))
    recipe, first = study.of_recipe, study.prior_configuration()
    assert first is not None
    assert (recipe["nes.std_dev"], first["nes.std_dev"]) == (0.0124, 0.03)
    assert first["nes.population_size"] == recipe["nes.population_size"]
    assert replace(study, prior="none").prior_configuration() is None
    search = BracketSearch.of(study, Journal(study.folder), 1)
    job = search.next_job()
    assert job is not None
    assert (job.configuration, job.origin) == (first, Origin.RECIPE)


def test_a_recipe_that_the_space_forbids_is_refused(tmp_path: Path) -> None:
    study = new_study(tmp_path / "study")
    dimension = CS.Integer("nes.population_size", (2, 48))
    space = CS.ConfigurationSpace(space=[dimension])
    space.add(CS.ForbiddenEqualsClause(dimension, study.base.nes.population_size))
    mine = replace(study, space=Space("mine", dict(space.to_serialized_dict())))
    assert mine.prior_configuration() is None
    with pytest.raises(InvalidInput, match="the search space forbids"):
        replace(mine, prior="recipe").prior_configuration()
