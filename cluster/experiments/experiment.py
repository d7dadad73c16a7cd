"""Definition of an experiment: the SEs that it needs, the agents that it trains, its findings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from bilevel.errors import InvalidInput
from bilevel.evaluation import EvaluationResult, comparable
from bilevel.nes import NESState
from bilevel.synthetic_env import load_se
from bilevel.tasks import Task
from cluster.experiments.agents import Evaluation, Found, Plan, Source
from cluster.experiments.conditions import CONDITIONS, REAL
from cluster.experiments.sizes import Size
from cluster.experiments.style import styled
from cluster.experiments.table import Row
from cluster.nes.run import NESRun
from cluster.storage.home import Home
from cluster.storage.run_folder import BEST_FILE, finals


@dataclass(frozen=True)
class SERun:
    """A condition's NES run, which learns one SE."""

    condition: str
    number: int
    run: NESRun

    @property
    def source(self) -> Source:
        """The run's best SE. Raises InvalidInput if its file is damaged."""
        return Source(self.condition, self.number, load_se(self.run.folder / BEST_FILE))

    @property
    def state(self) -> NESState:
        """The run's last state. Raises InvalidInput if its file is damaged or missing."""
        state = self.run.load()
        if state is None:
            raise InvalidInput(f"{str(self.run.folder)!r} has no checkpoint")
        return state

    @property
    def final(self) -> Mapping[str, float]:
        """Scores of fresh agents at the end of the run."""
        return finals(self.run.folder)[-1].metrics


def se_runs(runs: Mapping[str, int], task: Task, size: Size, seed: int, home: Home) -> list[SERun]:
    """Return the NES runs of each condition; number i has the seed `seed` + i."""
    return [
        SERun(name, number, CONDITIONS[name].run(task, size, seed + number, home))
        for name, ses in runs.items()
        for number in range(ses)
    ]


def _no_progress(done: int, total: int) -> None:
    pass


@dataclass(frozen=True)
class Material:
    """SEs and results that the findings of an experiment are computed from."""

    ses: Sequence[SERun]  # which have finished
    sources: Sequence[Source]  # of these SEs, in the same order
    found: Found
    folder: Path  # of the experiment
    progress: Callable[[int, int], None] = _no_progress  # gets the done and all steps of findings

    @classmethod
    def of(
        cls,
        ses: Sequence[SERun],
        found: Found,
        folder: Path,
        progress: Callable[[int, int], None] = _no_progress,
    ) -> "Material":
        """Load the SEs. Raises InvalidInput for a damaged one."""
        return cls(ses, [made.source for made in ses], found, folder, progress)

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
    #: Whether findings are updated before each further NES run. Only for experiments that train no
    #: agents; their NES runs may take days.
    interim: bool = False
    #: Kinds of agents by task, unless the user names others.
    agents: Callable[[str], tuple[str, ...]] = _only_ddqn

    def conclude(self, plan: Plan, material: Material) -> Findings:
        """Return the findings, with comparable scores of diverged agents."""
        asked = {evaluation.key for evaluation in self.evaluations(plan, material)}
        found = {key: result for key, result in material.found.items() if key in asked}
        found = dict(zip(found, comparable([*found.values()]), strict=True))
        with styled():
            return self.findings(plan, replace(material, found=found))
