"""What an experiment is: the SEs it needs, the agents it trains, and what it finds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from matplotlib.figure import Figure

from bilevel.errors import InvalidInput
from bilevel.evaluation import comparable
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.nes import NESState
from bilevel.synthetic_env import load_se
from bilevel.tasks import Task
from cluster.experiments.agents import Found, Source, Unit
from cluster.experiments.conditions import CONDITIONS, REAL
from cluster.experiments.sizes import Size
from cluster.experiments.style import styled
from cluster.experiments.table import Row
from cluster.nes.run import NESRun
from cluster.storage.home import Home
from cluster.storage.run_folder import BEST_FILE, finals


@dataclass(frozen=True)
class Plan:
    """An experiment's subject: task, size, kinds of agents, and the seed of everything."""

    task: Task
    size: Size
    kinds: tuple[AgentHyperparameters, ...]  # as agents of this size train
    seed: int


@dataclass(frozen=True)
class SERun:
    """A condition's NES run, which learns one SE."""

    condition: str
    number: int
    run: NESRun

    @property
    def source(self) -> Source:
        """The run's best SE, to train agents on. Raises InvalidInput if its file is damaged."""
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
    """The SEs, so many of each condition: number i of a condition has the run seed `seed` + i."""
    return [
        SERun(name, number, CONDITIONS[name].run(task, size, seed + number, home))
        for name, ses in runs.items()
        for number in range(ses)
    ]


@dataclass(frozen=True)
class Material:
    """All that an experiment has gathered."""

    ses: Sequence[SERun]
    sources: Sequence[Source]  # of these SEs, in the same order
    found: Found
    folder: Path  # of the experiment

    def of(self, condition: str) -> list[Source]:
        """The sources of a condition; the real task is always there."""
        if condition == REAL:
            return [Source(REAL)]
        return [source for source in self.sources if source.condition == condition]


@dataclass(frozen=True)
class Findings:
    """What an experiment found."""

    data: Sequence[Row]  # all values
    summary: Sequence[Row]  # in a few lines
    figures: Mapping[str, Figure]  # by name
    metrics: Mapping[str, float]
    notes: Sequence[str] = ()


def _no_units(plan: Plan, material: Material) -> list[Unit]:
    return []


@dataclass(frozen=True)
class Experiment:
    """An experiment, as plain functions."""

    name: str
    title: str
    explanation: str  # for the report
    #: Number of NES runs by condition.
    runs: Callable[[Size], dict[str, int]]
    findings: Callable[[Plan, Material], Findings]
    #: The agents to train. It is asked again until all are trained, so that which agents come next
    #: may depend on results.
    units: Callable[[Plan, Material], list[Unit]] = _no_units
    #: Makes files of its own in the folder; tells how many of how many are there.
    record: Callable[[Plan, Material, Callable[[int, int], None]], None] | None = None
    #: It trains no agents, and is concluded anew from the NES runs that have ended before each
    #: further one: all of them may take days.
    interim: bool = False
    #: Kinds of agents by task, and for any other task.
    agents: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    usual_agents: tuple[str, ...] = ("ddqn",)

    def conclude(self, plan: Plan, material: Material) -> Findings:
        """What all agents together tell, diverged ones included; pictures in the style of all."""
        asked = {unit.key for unit in self.units(plan, material)}  # others may lie in the folder
        found = {key: result for key, result in material.found.items() if key in asked}
        found = dict(zip(found, comparable([*found.values()]), strict=True))
        with styled():
            return self.findings(plan, replace(material, found=found))

    def kinds(self, task: Task) -> tuple[str, ...]:
        """Kinds of agents that it trains unless others are asked for."""
        return self.agents.get(task.id, self.usual_agents)
