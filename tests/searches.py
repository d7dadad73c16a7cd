"""Searches in one process, whose losses are computed from the configuration."""

from dataclasses import replace
from math import log
from pathlib import Path

import ConfigSpace as CS

from cluster.bohb.search.bracket_search import BracketSearch, Job
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal
from search_spaces.space import Space
from tests.studies import new_study

#: Hyperband's brackets.
LADDER = Schedule((1, 3, 9), 3)


def loss_of(job: Job) -> float:
    """A smooth function of the configuration with a clear optimum."""
    values = job.configuration
    step, units = values["nes.step_size"], values["se.hidden_size"]
    return log(step / 0.2) ** 2 + log(units / 8) ** 2 - 0.01 * job.budget


def new_search(folder: Path, brackets: int = 6, seed: int = 0) -> BracketSearch:
    study = replace(new_study(folder, seed), schedule=LADDER)
    return BracketSearch(study, Journal(folder), brackets)


def search_of(
    space: CS.ConfigurationSpace, folder: Path, brackets: int, **changes: object
) -> BracketSearch:
    """A search over a space, with other fields of the study in `changes`."""
    content = Space("mine", dict(space.to_serialized_dict()))
    study = replace(new_study(folder), space=content, **changes)  # type: ignore[arg-type]
    return BracketSearch(study, Journal(folder), brackets)


def run_to_end(search: BracketSearch, fail: tuple[int, ...] = ()) -> list[Job]:
    jobs: list[Job] = []
    while (job := search.next_job()) is not None:
        search.register(job, None if len(jobs) in fail else loss_of(job))
        jobs.append(job)
    assert search.finished
    return jobs
