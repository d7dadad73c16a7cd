"""Builds studies on disk fast: search and NES are real, but scores are computed from the
configuration instead of by training."""

import math
import time
from pathlib import Path

import numpy as np

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import load_recipe
from bilevel.nes.checkpoint import save_state
from bilevel.tasks import get_task
from cluster.bohb.brackets import Schedule
from cluster.bohb.journal import Journal
from cluster.bohb.profiles import get_profile, sized
from cluster.bohb.search import BracketSearch, Job
from cluster.bohb.study import Study
from cluster.nes.run import STATE_FILE
from cluster.nes.selection import FinalScore, export_best
from cluster.storage.run_folder import RunStatus, locked_settings
from search_spaces import Space


def new_study(folder: Path, seed: int = 0) -> Study:
    """A study of the smoke profile's size."""
    task, profile = get_task("CartPole-v0"), get_profile("smoke")
    base = sized(load_recipe("default", task.id), profile)
    return Study(folder, task, seed, Space("core"), Schedule((1, 3), 2), base)


def made_up(request: EvaluationRequest) -> EvaluationResult:
    """A made-up result of a request, whose score depends on the request's seed."""
    return EvaluationResult(
        test_returns=(100 * math.sin(request.seed % 1000) ** 2,),
        train_steps=500,
        train_episodes=20,
        real_env_steps=40,
        finite=True,
        index=request.index,
        seconds=0.01,
    )


def run_job(study: Study, job: Job) -> float:
    """Run generations up to the job's budget; return the objective."""
    run = study.run(job.id, job.configuration)
    nes = run.nes
    state = run.load() or nes.init()
    while state.generation < job.budget:
        before = state.generation
        state = nes.tell(state, [made_up(request) for request in nes.ask(state)])
        if state.generation > before:
            state = state.timed(0.5, 1, time.time())
        save_state(state, run.folder / STATE_FILE)
    return state.objective


def make_study(
    folder: Path, brackets: int = 2, fail: tuple[int, ...] = (), score: float = 100.0
) -> Study:
    """A finished study in which the jobs with the numbers in `fail` failed; fresh agents have that
    score on its best SE."""
    study = new_study(folder)
    with locked_settings(folder, study.settings()):
        search = BracketSearch.of(study, Journal(folder), brackets)
        number = 0
        while (job := search.next_job()) is not None:
            if number in fail:
                search.register(job, None, exception="Traceback\nValueError: made to fail")
            else:
                search.register(job, -run_job(study, job))
            number += 1
        line = next(line for line in Journal(folder).results if line.loss is not None)
        proposed = next(c for c in Journal(folder).configs if c.id == line.id)
        run = study.run(line.id, proposed.configuration)
        state = run.load()
        assert state is not None
        final = FinalScore(np.array([score - 10, score + 10]), np.array([400, 600]), 195.0)
        export_best(state.candidates[0], final, folder, len(Journal(folder).results))
        RunStatus("FINISHED", time.time(), brackets).save(folder)
    return study
