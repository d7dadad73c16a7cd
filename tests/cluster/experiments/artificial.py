"""Experiments without training: NES and the findings are real, the results are artificial."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import default_agents
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from cluster.experiments.experiment import (
    Evaluation,
    Experiment,
    Findings,
    Material,
    Plan,
    Source,
)
from cluster.experiments.sizes import SIZES
from cluster.nes.run import NESRun
from cluster.nes.selection import FinalScore, export_best
from cluster.storage.home import Home
from cluster.storage.run_folder import BEST_FILE, RunStatus, locked_settings
from tests.studies import MadeUpPool, made_up


def finish(run: NESRun) -> None:
    """Finish an NES run."""
    with locked_settings(run.folder, run.settings()):
        state = run.open()
        while not state.finished:
            state = run.advance(state, MadeUpPool())
        final = FinalScore(np.array([150.0, 200.0]), np.array([400, 600]), 195.0)
        export_best(
            run.nes.best(state), final, run.folder, state.generation, state.real_env_steps, 0
        )
        RunStatus("FINISHED", time.time(), run.hp.nes.generations).save(run.folder)


def smoke_plan(experiment: Experiment, task_id: str = "CartPole-v0") -> Plan:
    """Return the experiment's plan of the size smoke."""
    task, size = get_task(task_id), SIZES["smoke"]
    kinds = default_agents(experiment.agents(task_id))
    return Plan(task, size, size.trained(kinds), 0)


def result_of(evaluation: Evaluation) -> EvaluationResult:
    """Return a result that depends on seed and length of training."""
    request = EvaluationRequest(0, evaluation.seed, evaluation.hp)
    result, episodes = made_up(request), evaluation.hp.max_episodes
    return replace(result, train_episodes=episodes, train_steps=40 * episodes, real_env_steps=9)


def material_of(experiment: Experiment, plan: Plan, home: Path) -> Material:
    """Return the experiment's SEs, whose NES runs are in the home, and artificial results."""
    runs = plan.runs(experiment, Home(home))
    for run in runs.values():
        if not run.ended:
            finish(run)
    sources = [Source(*place, load_se(run.folder / BEST_FILE), run) for place, run in runs.items()]
    material = Material(sources, {})
    while missing := [
        one for one in experiment.evaluations(plan, material) if one.key not in material.found
    ]:
        material.found.update({one.key: result_of(one) for one in missing})
    return material


def findings_of(experiment: Experiment, home: Path, task_id: str = "CartPole-v0") -> Findings:
    """Return the experiment's findings from artificial results."""
    plan = smoke_plan(experiment, task_id)
    return experiment.conclude(plan, material_of(experiment, plan, home))
