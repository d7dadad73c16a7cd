"""Searches without Ray."""

import math
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ConfigSpace as CS
import numpy as np
import pytest

from bilevel.errors import InvalidInput
from bilevel.hyperparameters import load_recipe
from cluster.bohb.results.importance import unit_values
from cluster.bohb.search.bracket_search import BracketSearch, Job
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal, Origin
from search_spaces.bohb import search_space
from search_spaces.prior import nearest
from search_spaces.translation import of_hyperparameters
from tests.searches import LADDER, loss_of, new_search, run_to_end


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[Job]:
    """The jobs of a search that was never interrupted."""
    return run_to_end(new_search(tmp_path_factory.mktemp("whole")))


@dataclass(frozen=True)
class LongSearch:
    """A search in which the model has learned."""

    journal: Journal
    jobs: list[Job]


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> LongSearch:
    search = new_search(folder := tmp_path_factory.mktemp("long"), brackets=15)
    jobs = run_to_end(search)
    return LongSearch(Journal(folder), jobs)


def test_runs_the_bracket_table(whole: list[Job]) -> None:
    for rung in LADDER.brackets(6):
        count = sum(job.id[0] == rung.bracket and job.budget == rung.budget for job in whole)
        assert count == rung.configurations


def test_promotes_the_best(tmp_path: Path) -> None:
    jobs = run_to_end(new_search(tmp_path, brackets=1))
    lowest = sorted((job for job in jobs if job.budget == 1), key=loss_of)
    assert {job.id for job in jobs if job.budget == 3} == {job.id for job in lowest[:3]}


def test_model_based_picks_happen_and_help(long: LongSearch) -> None:
    firsts = {job.id: job for job in reversed(long.jobs)}.values()
    model = [loss_of(job) for job in firsts if job.origin is Origin.MODEL]
    rand = [loss_of(job) for job in firsts if job.origin is not Origin.MODEL]
    assert len(model) >= 10
    assert sum(model) / len(model) < 0.7 * sum(rand) / len(rand)


def test_failures_count_as_worst_and_are_not_promoted(tmp_path: Path) -> None:
    search = new_search(tmp_path, brackets=1)
    jobs = run_to_end(search, fail=tuple(range(8)))
    assert len(jobs) == 9 + 3 + 1  # empty places are filled with new configurations
    failed = {job.id for job in jobs[:8]}
    assert not any(job.id in failed for job in jobs if job.budget > 1)
    assert sum(line.loss is None for line in Journal(tmp_path).results) == 8


def test_seed_decides(whole: list[Job], tmp_path: Path) -> None:
    again = run_to_end(new_search(tmp_path / "again"))
    other = run_to_end(new_search(tmp_path / "other", brackets=1, seed=1))
    assert [job.configuration for job in again] == [job.configuration for job in whole]
    assert other[0].configuration != whole[0].configuration


@pytest.mark.parametrize("seed", range(8))
def test_interrupted_anywhere_it_goes_on_the_same(
    seed: int, whole: list[Job], tmp_path: Path
) -> None:
    """A search that is killed after any number of results, with or without a job in flight,
    resumes from its journal with the same results."""
    chance = random.Random(seed)
    search = new_search(tmp_path / "parts")
    done: list[Job] = []
    while (job := search.next_job()) is not None:
        if chance.random() < 0.3:
            search = new_search(tmp_path / "parts")
            continue
        search.register(job, loss_of(job))
        done.append(job)
        if chance.random() < 0.2:
            search = new_search(tmp_path / "parts")
    assert search.finished
    assert [(j.id, j.budget, j.configuration) for j in done] == [
        (j.id, j.budget, j.configuration) for j in whole
    ]


def test_fewer_brackets_than_there_are_is_refused(tmp_path: Path) -> None:
    run_to_end(new_search(tmp_path, brackets=3))
    with pytest.raises(InvalidInput, match="has begun 3 brackets, 2 are asked for: ask for 3 at"):
        new_search(tmp_path, brackets=2)


def test_more_brackets_use_all_that_came_before(tmp_path: Path) -> None:
    run_to_end(new_search(tmp_path, brackets=6))
    more = run_to_end(new_search(tmp_path, brackets=9))
    assert {job.id[0] for job in more} == {6, 7, 8}
    assert any(job.origin is Origin.MODEL for job in more)


def test_a_space_with_conditions_is_searched_the_same_again(tmp_path: Path) -> None:
    """hpbandster draws values for inactive hyperparameters when it learns of a result."""
    space = CS.ConfigurationSpace()
    kind = CS.Categorical("nes.shared_agent", [True, False])
    only_if = CS.Float("nes.std_dev", (0.01, 1.0), log=True)
    always = CS.Float("nes.step_size", (0.01, 1.0), log=True)
    space.add(kind, only_if, always)
    space.add(CS.EqualsCondition(only_if, kind, True))

    def loss(job: Job) -> float:
        return abs(math.log(job.configuration["nes.step_size"] / 0.1))

    def search(name: str, brackets: int) -> BracketSearch:
        return BracketSearch(space, LADDER, brackets, 3, Journal(tmp_path / name))

    for name, stops in (("one", [8]), ("again", [8]), ("resumed", [3, 5, 8])):
        for brackets in stops:
            np.random.seed(len(name) + brackets)  # a global generator must not matter
            run = search(name, brackets)
            while (job := run.next_job()) is not None:
                run.register(job, loss(job))
    found = [
        [(line.id, line.configuration) for line in Journal(tmp_path / name).configs]
        for name in ("one", "again", "resumed")
    ]
    assert found[0] == found[1] == found[2]
    assert any(line.origin is Origin.MODEL for line in Journal(tmp_path / "one").configs)


def test_the_search_begins_with_it_and_stays_near_it_half_of_the_time(tmp_path: Path) -> None:
    space = search_space("core")
    prior = nearest(space, of_hyperparameters(load_recipe("default", "CartPole-v0"), space))
    schedule, journal = Schedule((1,), 1), Journal(tmp_path)
    search = BracketSearch(space, schedule, 200, 0, journal, model=False, prior=prior)
    jobs = run_to_end(search)
    assert jobs[0].configuration == prior
    origins = {job.origin for job in jobs[1:]}
    assert jobs[0].origin is Origin.RECIPE
    assert origins == {Origin.AROUND_RECIPE, Origin.RANDOM}
    drawn = [bool(line.info.get("prior")) for line in journal.configs]
    assert 70 < sum(drawn) < 130

    def distance(values: dict[str, Any]) -> float:
        """Mean over the dimensions, in units of their ranges."""
        return float(np.abs(unit_values(space, values) - unit_values(space, prior)).mean())

    distances = np.array([distance(line.configuration) for line in journal.configs])
    near, far = distances[drawn].mean(), distances[~np.array(drawn)].mean()
    assert near < 0.15 < 0.2 < far
    again = BracketSearch(space, schedule, 200, 0, Journal(tmp_path), model=False, prior=prior)
    assert again.next_job() is None  # all of it is in the journal


def test_the_model_proposes_at_once_and_better(long: LongSearch, tmp_path: Path) -> None:
    space, journal = search_space("core"), Journal(tmp_path / "later")
    search = BracketSearch(space, LADDER, 1, 7, journal, earlier=long.journal)
    jobs = run_to_end(search)
    assert any(job.origin is Origin.MODEL for job in jobs[:5])
    alone = run_to_end(new_search(tmp_path / "alone", brackets=1, seed=7))
    losses = [np.mean([loss_of(job) for job in found]) for found in (jobs, alone)]
    assert losses[0] < losses[1]


def test_a_model_of_larger_budgets_does_not_drown_the_search(
    long: LongSearch, tmp_path: Path
) -> None:
    """hpbandster's model of the largest budget proposes, and takes no results of lower ones."""
    space = search_space("core")
    assert max(line.budget for line in long.journal.results) == 9
    found = []
    for prior in (long.journal, None):
        journal = Journal(tmp_path / f"later-{prior is None}")
        search = BracketSearch(space, Schedule((1,), 1), 30, 7, journal, earlier=prior)
        run_to_end(search)
        models = search._generator.kde_models
        assert set(models) == {1}
        found.append(search._generator.losses[1])
    assert len(found[0]) > len(found[1]) == 30
