"""Searches that start with a recipe or with the results of another study."""

import json
import shutil
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
from cluster.bohb.study.prior import (
    check_prior,
    copy_prior,
    earlier_results,
    prior_configuration,
    search_seed,
)
from search_spaces.space import Space
from tests.searches import LADDER
from tests.studies import make_study, new_study


def test_the_first_configuration_is_the_recipe_within_the_space(tmp_path: Path) -> None:
    study = replace(new_study(tmp_path), prior="recipe", base=load_recipe("paper", "CartPole-v0"))
    recipe, first = study.of_recipe, prior_configuration(study)
    assert first is not None
    assert (recipe["nes.std_dev"], first["nes.std_dev"]) == (0.0124, 0.03)
    assert first["nes.population_size"] == recipe["nes.population_size"]
    assert prior_configuration(replace(study, prior="none")) is None
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
    check_prior(mine)
    with pytest.raises(InvalidInput, match="the search space forbids"):
        check_prior(replace(mine, prior="recipe"))


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A study with enough results for the model."""
    study = make_study(tmp_path_factory.mktemp("home") / "earlier-one", brackets=12)
    study.write_space()
    return study


@pytest.fixture
def later(earlier: Study, tmp_path: Path) -> Study:
    shutil.copytree(earlier.folder, tmp_path / "earlier-one")
    folder = tmp_path / "later"
    return replace(earlier, folder=folder, prior="earlier-one", seed=5, schedule=LADDER)


def test_the_results_of_a_prior_study_are_copied_once(later: Study, earlier: Study) -> None:
    check_prior(later)
    copy_prior(later)
    shutil.rmtree(later.folder.parent / later.prior)
    check_prior(later)
    copy_prior(later)
    copied = earlier_results(later)
    assert copied is not None
    assert copied.results == Journal(earlier.folder).results
    search = BracketSearch.of(later, Journal(later.folder), 1)
    jobs = [search.next_job() for _ in range(9)]
    assert any(job is not None and job.origin is Origin.MODEL for job in jobs)


def test_a_study_with_the_seed_of_its_prior_draws_other_configurations(
    later: Study, earlier: Study
) -> None:
    same = replace(later, seed=earlier.seed, schedule=earlier.schedule)
    copy_prior(same)
    assert search_seed(same) != search_seed(earlier) == earlier.seed
    search = BracketSearch.of(same, Journal(same.folder), 6)
    drawn = [job for job in (search.next_job() for _ in range(18)) if job is not None]
    assert Origin.RANDOM in {job.origin for job in drawn}
    before = {json.dumps(line.configuration) for line in Journal(earlier.folder).configs}
    assert not before & {json.dumps(job.configuration) for job in drawn}
    first, second = (ConfigurationRuns(study, (0, 0, 0), {}).run(0) for study in (same, earlier))
    assert first.seed != second.seed


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"prior": "unknown"}, r"unknown prior 'unknown': .*studies on the same"),
        ({"space": Space("full")}, "cannot be the prior: it searched another space"),
        ({"method": "random"}, "cannot be the prior: only the method bohb has a model"),
        ({"schedule": Schedule((10, 30), 1)}, "it has no results at the budgets 10, 30"),
    ],
)
def test_unsuitable_priors_are_refused(
    changes: dict[str, object], message: str, later: Study
) -> None:
    with pytest.raises(InvalidInput, match=message):
        check_prior(replace(later, **changes))  # type: ignore[arg-type]
    assert not later.folder.exists()


def test_a_prior_with_the_ranges_of_another_version_is_refused(later: Study) -> None:
    path = later.folder.parent / later.prior / SPACE_FILE
    stored = json.loads(path.read_text())
    stored["hyperparameters"][0]["upper"] *= 4
    path.write_text(json.dumps(stored))
    with pytest.raises(InvalidInput, match="cannot be the prior: it searched another space"):
        check_prior(later)
