"""Definition of an experiment: the SEs that it needs, the agents that it trains, its findings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from bilevel.agents.variation import VARIED
from bilevel.evaluation import EvaluationResult, comparable
from bilevel.tasks import Task
from cluster.experiments.agents import Evaluation, Found, Plan, Source
from cluster.experiments.conditions import CONDITIONS, REAL
from cluster.experiments.sizes import Size
from cluster.experiments.style import styled
from cluster.experiments.table import Row
from cluster.nes.run import NESRun
from cluster.storage.home import Home


def se_runs(
    runs: Mapping[str, int], task: Task, size: Size, seed: int, home: Home
) -> dict[tuple[str, int], NESRun]:
    """Return the NES runs by condition and number; number i has the seed `seed` + i."""
    return {
        (name, number): CONDITIONS[name].run(task, size, seed + number, home)
        for name, ses in runs.items()
        for number in range(ses)
    }


def _no_progress(done: int, total: int) -> None:
    pass


@dataclass(frozen=True)
class Material:
    """SEs and results that the findings of an experiment are computed from."""

    sources: Sequence[Source]  # without the real task
    found: Found
    progress: Callable[[int, int], None] = _no_progress  # gets the done and all steps of findings

    def on(self, *conditions: str) -> list[Source]:
        """Return the sources of conditions; REAL is the real task."""
        return [
            source
            for name in conditions
            for source in (Source(REAL), *self.sources)
            if source.condition == name
        ]

    def result(self, evaluation: Evaluation) -> EvaluationResult:
        """Return the result of an evaluation."""
        return self.found[evaluation.key]

    def agents(self, evaluations: Sequence[Evaluation]) -> pd.DataFrame:
        """Return a row per evaluation: source, position, hyperparameters and results."""
        rows = []
        for evaluation in evaluations:
            result, hp, source = self.result(evaluation), evaluation.hp, evaluation.source
            row: dict[str, Any] = {
                "agent": hp.agent,
                "source": source.condition,
                "se": None if source.se is None else source.number,
                "position": evaluation.position,
                **{name: getattr(hp, name, None) for name in VARIED},
                "score": result.score,
                "train_steps": result.train_steps,
                "train_episodes": result.train_episodes,
                "core_seconds": result.cost,
            }
            rows.append(row | {f"return_{i}": value for i, value in enumerate(result.test_returns)})
        return pd.DataFrame(rows, dtype=object)  # integers stay integers next to missing values


@dataclass(frozen=True)
class Findings:
    """Results of an experiment."""

    data: pd.DataFrame  # all values
    summary: Sequence[Row]
    figures: Mapping[str, Figure]  # by name
    metrics: Mapping[str, float]
    notes: Sequence[str] = ()


def _no_evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    return []


def _only_ddqn(task_id: str) -> tuple[str, ...]:
    return ("ddqn",)


@dataclass(frozen=True)
class Experiment:
    """An experiment, as plain functions."""

    name: str
    title: str
    explanation: str  # for the report
    #: Number of NES runs by condition.
    runs: Callable[[Size], dict[str, int]]
    findings: Callable[[Plan, Material], Findings]
    #: The agents to train. It is called again with their results until no agent is missing, so
    #: that later agents may depend on earlier results.
    evaluations: Callable[[Plan, Material], list[Evaluation]] = _no_evaluations
    #: Kinds of agents by task, unless the user names others.
    agents: Callable[[str], tuple[str, ...]] = _only_ddqn

    def conclude(self, plan: Plan, material: Material) -> Findings:
        """Return the findings, with comparable scores of diverged agents."""
        asked = {evaluation.key for evaluation in self.evaluations(plan, material)}
        found = {key: result for key, result in material.found.items() if key in asked}
        found = dict(zip(found, comparable([*found.values()]), strict=True))
        with styled():
            return self.findings(plan, replace(material, found=found))
