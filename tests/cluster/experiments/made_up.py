"""Experiments without training: NES and all that follows are real, but results are made up."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import default_agents
from bilevel.tasks import Task, get_task
from cluster.experiments.agents import AgentResults, Unit
from cluster.experiments.experiment import Experiment, Findings, Material, Plan, se_runs
from cluster.experiments.sizes import get_size
from cluster.nes.run import NESRun
from cluster.nes.selection import FinalScore, export_best
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, locked_settings
from tests.results import made_up_result
from tests.studies import MadeUpPool, made_up


def end_run(run: NESRun) -> None:
    """Bring an NES run to its end; distilling a start would take seconds, so it starts from a
    random SE."""
    run = replace(run, hp=replace(run.hp, nes=replace(run.hp.nes, start="random")))
    with locked_settings(run.folder, run.settings()):
        state = run.open()
        while not state.finished:
            state = run.advance(state, MadeUpPool())
        final = FinalScore(np.array([150.0, 200.0]), np.array([400, 600]), 195.0)
        export_best(state.best, final, run.folder, state.generation, state.real_env_steps, 0)
        RunStatus("FINISHED", time.time(), run.hp.nes.generations).save(run.folder)


def smoke_plan(experiment: Experiment, task_id: str = "CartPole-v0", seed: int = 0) -> Plan:
    """The experiment of the size smoke."""
    task, size = get_task(task_id), get_size("smoke")
    kinds = default_agents(experiment.kinds(task))
    return Plan(task, size, size.trained(kinds), seed)


def result_of(unit: Unit) -> EvaluationResult:
    """A made-up result, which depends on the unit's seed and length of training."""
    result, episodes = made_up(unit.request(0)), unit.hp.max_episodes
    return replace(result, train_episodes=episodes, train_steps=40 * episodes, real_env_steps=9)


def material_of(experiment: Experiment, plan: Plan, home: Home) -> Material:
    """All that the experiment needs, made up; its NES runs are in the home."""
    ses = se_runs(experiment.runs(plan.size), plan.task, plan.size, plan.seed, home)
    for made in ses:
        if not made.run.ended:
            end_run(made.run)
    folder = home.run_folder(plan.task.id, f"experiment-smoke-{experiment.name}-seed{plan.seed}")
    folder.mkdir(parents=True, exist_ok=True)
    results = AgentResults(folder)
    material = Material(ses, [made.source for made in ses], results.found, folder)
    while missing := [
        unit for unit in experiment.units(plan, material) if unit.key not in results.found
    ]:
        for unit in missing:
            results.add(unit, result_of(unit))
    if experiment.record is not None:
        experiment.record(plan, material, lambda done, total: None)
    return material


def findings_of(experiment: Experiment, home: Path, task_id: str = "CartPole-v0") -> Findings:
    """What the experiment finds in made-up results."""
    plan = smoke_plan(experiment, task_id)
    return experiment.conclude(plan, material_of(experiment, plan, Home(home)))


def group_results(task: Task, scores: list[float]) -> tuple[EvaluationResult, ...]:
    """Results of agents with these scores."""
    return tuple(
        made_up_result(i, *(score,) * 10, train_steps=900 + i, train_episodes=40)
        for i, score in enumerate(scores)
    )
