"""Definition of an experiment: the SEs that it needs, the agents that it trains, its findings.

An agent's result is a pure function of its evaluation. Results are therefore stored under a digest
of the evaluation, and experiments and sizes share them.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from bilevel.agents import get_agent
from bilevel.agents.variation import VARIED
from bilevel.durable import checksum
from bilevel.evaluation import EvaluationResult, comparable
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.nes import NESState
from bilevel.nes.requests import fresh_agent
from bilevel.seeds import Purpose
from bilevel.synthetic_env import StoredSE
from bilevel.tasks import Task
from cluster.evaluate.report import Row
from cluster.experiments.conditions import CONDITIONS, REAL
from cluster.experiments.sizes import AGENTS, Size
from cluster.experiments.style import styled
from cluster.nes.run import NESRun
from cluster.storage.home import Home


@dataclass(frozen=True)
class Plan:
    """Subject of an experiment: task, size, kinds of agents, and the seed of everything."""

    task: Task
    size: Size
    kinds: tuple[AgentHyperparameters, ...]  # with the training episodes of this size
    seed: int

    def runs(self, experiment: "Experiment", home: Home) -> dict[tuple[str, int], NESRun]:
        """Return the NES runs by condition and number; number i has the seed `seed` + i."""
        return {
            (name, i): CONDITIONS[name].run(self.task, self.size, self.seed + i, home)
            for name, ses in experiment.runs(self.size).items()
            for i in range(ses)
        }

    def evaluations(
        self,
        sources: Iterable["Source"],
        kinds: Iterable[AgentHyperparameters],
        agents: int,
        on_real: int = 0,
        per_se: int = AGENTS,
        vary: str = "all",
    ) -> list["Evaluation"]:
        """Return `agents` agents of each kind on each SE, and `on_real` on the real task.

        Seed and hyperparameters, which are drawn according to `vary`, depend on the position alone.
        The agents on the real task have the positions of `per_se` agents on each of several SEs.
        """
        found = []
        for source in sources:
            places = [(source.number, agent) for agent in range(agents)]
            if source.se is None:
                places = [divmod(number, per_se) for number in range(on_real)]
            for kind in kinds:
                for se, agent in places:
                    seed, hp = fresh_agent((kind,), vary, self.seed, Purpose.EXPERIMENT, se, agent)
                    found.append(Evaluation(self.task, source, f"{se}-{agent}", hp, seed))
        return found


@dataclass(frozen=True)
class Source:
    """Training environment of agents: the SE of a condition's NES run, or the real task."""

    condition: str  # REAL for the real task
    number: int = 0  # of the condition's run
    se: StoredSE | None = None  # None: the real task
    run: NESRun | None = None  # which has finished

    @property
    def state(self) -> NESState:
        """The last state of the run. Raises InvalidInput if its file is damaged or missing."""
        assert self.run is not None
        return self.run.nes.load(self.run.state_file)

    @property
    def digest(self) -> str:
        """Digest of the SE's networks."""
        return REAL if self.se is None else self.se.se.digest


@dataclass(frozen=True)
class Evaluation:
    """One agent to train on a source and to test on the task."""

    task: Task
    source: Source
    position: str  # "SE-agent": equal positions have equal agents on every source
    hp: AgentHyperparameters
    seed: int

    @cached_property
    def key(self) -> str:
        """Digest of everything that the result depends on."""
        facts = [asdict(self.task), self.source.digest, self.hp.agent, asdict(self.hp), self.seed]
        code = self.task.code_digest, get_agent(self.hp.agent).code_digest
        facts += [code] if any(code) else []
        return checksum(json.dumps(facts, sort_keys=True).encode())[:32]


#: Results by the keys of the evaluations.
Found = dict[str, EvaluationResult]


@dataclass(frozen=True)
class Material:
    """SEs and results that the findings of an experiment are computed from."""

    sources: Sequence[Source]  # without the real task
    found: Found
    progress: Callable[[int, int], None] = lambda done, total: None  # with steps and all steps

    def on(self, *conditions: str) -> list[Source]:
        """Return the sources of conditions; REAL is the real task."""
        sources = (Source(REAL), *self.sources)
        return [source for name in conditions for source in sources if source.condition == name]

    def agents(self, evaluations: Sequence[Evaluation]) -> pd.DataFrame:
        """Return a row per evaluation: source, position, hyperparameters and results."""
        rows = []
        for evaluation in evaluations:
            result, hp, source = self.found[evaluation.key], evaluation.hp, evaluation.source
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


@dataclass(frozen=True)
class Experiment:
    """An experiment, as plain functions."""

    name: str
    title: str
    explanation: str  # for the report
    #: Number of NES runs by condition.
    runs: Callable[[Size], dict[str, int]]
    findings: Callable[[Plan, Material], Findings]
    #: The agents to train. It is called again with their results until none is missing.
    evaluations: Callable[[Plan, Material], list[Evaluation]] = lambda plan, material: []
    #: Kinds of agents by task, unless the user names others.
    agents: Callable[[str], tuple[str, ...]] = lambda task_id: ("ddqn",)

    def conclude(self, plan: Plan, material: Material) -> Findings:
        """Return the findings, with comparable scores of diverged agents."""
        asked = {evaluation.key for evaluation in self.evaluations(plan, material)}
        found = {key: result for key, result in material.found.items() if key in asked}
        found = dict(zip(found, comparable([*found.values()]), strict=True))
        with styled():
            return self.findings(plan, replace(material, found=found))
