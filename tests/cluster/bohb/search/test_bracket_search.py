"""Searches in one process, without Ray."""

import math
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import ConfigSpace as CS
import numpy as np
import pytest

from cluster.bohb.results.importance import unit_values
from cluster.bohb.search.bracket_search import BracketSearch, Job
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal, Origin
from cluster.bohb.study.profiles import METHODS
from tests.searches import LADDER, loss_of, new_search, run_to_end, search_of
from tests.studies import new_study


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[Job]:
    """Jobs of a search that was not interrupted."""
    return run_to_end(new_search(tmp_path_factory.mktemp("whole")))


def test_failures_rank_last_and_are_replaced(tmp_path: Path) -> None:
    jobs = run_to_end(new_search(tmp_path, brackets=1), fail=tuple(range(8)))
    assert len(jobs) == 9 + 3 + 1
    failed = {job.id for job in jobs[:8]}
    assert not any(job.id in failed for job in jobs if job.budget > 1)
    assert sum(line.loss is None for line in Journal(tmp_path).results) == 8


def test_the_best_of_every_rung_are_promoted(whole: list[Job], tmp_path: Path) -> None:
    for rung in LADDER.brackets(6):
        count = sum(job.id[0] == rung.bracket and job.budget == rung.budget for job in whole)
        assert count == rung.configurations
    lowest = sorted((job for job in whole if job.id[0] == 0 and job.budget == 1), key=loss_of)
    promoted = {job.id for job in whole if job.id[0] == 0 and job.budget == 3}
    assert promoted == {job.id for job in lowest[:3]}
    other = new_search(tmp_path, seed=1).next_job()
    assert other is not None
    assert other.configuration != whole[0].configuration


@pytest.mark.parametrize("seed", range(5))
def test_a_resumed_search_has_the_same_jobs(seed: int, whole: list[Job], tmp_path: Path) -> None:
    """It is killed after any number of results, with or without a job in flight; brackets are
    added."""
    chance = random.Random(seed)
    search = new_search(tmp_path, brackets=1)
    done: list[Job] = []
    while len(done) < len(whole):
        job = search.next_job()
        if job is None or chance.random() < 0.3:
            search = new_search(tmp_path)
            continue
        search.register(job, loss_of(job))
        done.append(job)
        if chance.random() < 0.2:
            search = new_search(tmp_path)
    assert search.next_job() is None
    assert search.finished
    found, expected = (
        [(job.id, job.budget, job.configuration) for job in jobs] for jobs in (done, whole)
    )
    assert found == expected


def test_a_space_with_conditions_is_resumed_with_the_same_jobs(tmp_path: Path) -> None:
    """hpbandster imputes values of inactive hyperparameters from numpy's global generator."""
    space = CS.ConfigurationSpace()
    kind = CS.Categorical("nes.shared_agent", [True, False])
    conditional = CS.Float("nes.std_dev", (0.01, 1.0), log=True)
    space.add(kind, conditional, CS.Float("nes.step_size", (0.01, 1.0), log=True))
    space.add(CS.EqualsCondition(conditional, kind, True))
    found = []
    for name, stops in (("whole", [8]), ("resumed", [3, 5, 8])):
        for brackets in stops:
            np.random.seed(brackets)
            search = search_of(space, tmp_path / name, brackets, schedule=LADDER)
            while (job := search.next_job()) is not None:
                search.register(job, abs(math.log(job.configuration["nes.step_size"] / 0.1)))
        found.append([line.configuration for line in Journal(tmp_path / name).configs])
    assert found[0] == found[1]
    assert any(line.origin is Origin.MODEL for line in Journal(tmp_path / "whole").configs)


@pytest.mark.parametrize("method", METHODS)
def test_only_bohb_uses_the_model(method: str, tmp_path: Path) -> None:
    study = replace(new_study(tmp_path, seed=3), method=method)
    jobs = run_to_end(BracketSearch(study, Journal(tmp_path), 12))
    assert any(job.origin is Origin.MODEL for job in jobs) == (method == "bohb")


def test_half_of_the_random_configurations_are_near_the_prior(tmp_path: Path) -> None:
    study = replace(
        new_study(tmp_path), schedule=Schedule((1,), 1), method="random", prior="recipe"
    )
    prior, space = study.prior_configuration(), study.space.build()
    assert prior is not None
    first, *others = run_to_end(BracketSearch(study, Journal(tmp_path), 200))
    assert (first.configuration, first.origin) == (prior, Origin.RECIPE)

    def distance(values: dict[str, Any]) -> float:
        return float(np.abs(unit_values(space, values) - unit_values(space, prior)).mean())

    near, far = (
        [distance(job.configuration) for job in others if job.origin is origin]
        for origin in (Origin.AROUND_RECIPE, Origin.RANDOM)
    )
    assert len(near) + len(far) == len(others)
    assert 70 < len(near) < 130
    assert np.mean(near) < 0.15 < 0.2 < np.mean(far)
