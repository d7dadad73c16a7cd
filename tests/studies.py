"""Builds studies on disk fast: search and NES are real, but scores are computed from the
configuration instead of by training."""

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource
from bilevel.recipes import load_recipe
from bilevel.tasks import Task, get_task
from cluster.bohb.search.bracket_search import BracketSearch, Job
from cluster.bohb.search.objective import Tally
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import Journal
from cluster.bohb.study.profiles import PROFILES, sized
from cluster.nes.selection import FinalScore, export_best
from cluster.ray.pool import EvaluationPool
from cluster.storage.run_folder import RunStatus, locked_settings
from search_spaces.space import Space
from tests.results import made_up_result


def new_study(folder: Path, seed: int = 0) -> Study:
    """A study of the smoke profile's size."""
    task, profile = get_task("CartPole-v0"), PROFILES["smoke"]
    base = sized(load_recipe("exogenous", task.id), profile)
    return Study(folder, task, seed, Space("core"), Schedule((1, 3), 2), base)


def made_up(request: EvaluationRequest) -> EvaluationResult:
    """A made-up result of a request, whose score depends on the seeds of agent and SE."""
    seed = request.seed + getattr(request.on, "seed", 0)
    score = 100 * math.sin(seed % 1000) ** 2
    return made_up_result(request.index, score, train_steps=500, real_env_steps=40, cost=0.01)


class MadeUpPool(EvaluationPool):
    """A pool without actors, whose results are made up."""

    def __init__(self) -> None:
        super().__init__(0)
        self.size = 1

    def run(
        self,
        task: Task,
        se: SESource,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> list[EvaluationResult]:
        return [made_up(request) for request in requests]


def run_job(study: Study, job: Job) -> Tally:
    """Run NES up to the job's budget; return its tally."""
    runs = ConfigurationRuns(study, job.id, job.configuration).read()
    runs.spend(job.budget, MadeUpPool())
    return runs.tally


def make_study(
    folder: Path, brackets: int = 2, fail: tuple[int, ...] = (), score: float = 100.0
) -> Study:
    """A finished study in which the jobs with the numbers in `fail` failed; fresh agents have that
    score on its best SE."""
    study = new_study(folder)
    with locked_settings(folder, study.settings()):
        search = BracketSearch(study, Journal(folder), brackets)
        number = 0
        while (job := search.next_job()) is not None:
            if number in fail:
                search.register(job, None, exception="Traceback\nValueError: made to fail")
            else:
                tally = run_job(study, job)
                search.register(job, tally.objective, tally.info)
            number += 1
        line = next(line for line in Journal(folder).results if line.loss is not None)
        proposed = next(c for c in Journal(folder).configs if c.id == line.id)
        best = ConfigurationRuns(study, line.id, proposed.configuration).read().best
        assert best is not None
        final = FinalScore(np.array([score - 10, score + 10]), np.array([400, 600]), 195.0)
        export_best(best, final, folder, len(Journal(folder).results), 1000, 0)
        RunStatus("FINISHED", time.time(), brackets).save(folder)
    return study
