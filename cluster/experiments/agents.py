"""The fresh agents of the experiments: which agent trains on which source, and their results.

An evaluation is a pure function of its request, so a result is kept under a digest of all that it
depends on. Whatever experiment, size or machine trained an agent, it is not trained again.
"""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from bilevel.agents import get_agent
from bilevel.durable import checksum
from bilevel.errors import InvalidInput
from bilevel.evaluation import (
    Centre,
    EvaluationRequest,
    EvaluationResult,
    Given,
    RealTask,
    TrainedOn,
)
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.nes.requests import fresh_agent
from bilevel.seeds import Purpose
from bilevel.synthetic_env import StoredSE
from bilevel.tasks import Task
from cluster.experiments.conditions import REAL
from cluster.experiments.run import RESULTS_FILE
from cluster.experiments.sizes import AGENTS
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import read_settings

#: Characters of a digest that are kept.
_DIGEST = 32


@dataclass(frozen=True)
class Source:
    """What agents train on: the SE of a condition's run, or the real task."""

    condition: str  # REAL for the real task
    number: int = 0  # of the condition's run
    se: StoredSE | None = None  # None: the real task

    @property
    def digest(self) -> str:
        """Digest of the SE's networks."""
        return REAL if self.se is None else self.se.se.digest


@dataclass(frozen=True)
class Place:
    """Position of an agent: agent `agent` of SE number `se`.

    Its seed and hyperparameters depend on the position alone, so that every condition, and the real
    task, train the same agents.
    """

    se: int
    agent: int

    @classmethod
    def on_real(cls, agents: int) -> list["Place"]:
        """Positions of that many agents on the real task: all those of one SE after the other."""
        return [cls(*divmod(number, AGENTS)) for number in range(agents)]


@dataclass(frozen=True)
class Unit:
    """One agent to train on a source and to test on the task."""

    task: Task
    source: Source
    place: Place
    hp: AgentHyperparameters
    seed: int

    @classmethod
    def of(
        cls,
        task: Task,
        source: Source,
        place: Place,
        kind: AgentHyperparameters,
        seed: int,
        vary: str = "all",
    ) -> "Unit":
        """The agent of that kind at that position, its hyperparameters drawn anew as `vary`
        says."""
        path = (Purpose.EXPERIMENT, place.se, place.agent)
        own, hp = fresh_agent((kind,), vary, seed, *path)
        return cls(task, source, place, hp, own)

    @cached_property
    def key(self) -> str:
        """Digest of all that the result depends on."""
        facts = [asdict(self.task), self.source.digest, self.hp.agent, asdict(self.hp), self.seed]
        code = self.task.code_digest, get_agent(self.hp.agent).code_digest
        facts += [code] if any(code) else []
        if not self.task.compiled:
            facts.append("a seed an episode")  # which before only the first one had
        return checksum(json.dumps(facts, sort_keys=True).encode())[:_DIGEST]

    def shorter(self, episodes: int) -> "Unit":
        """The same agent, stopped after so many episodes if it has not stopped before."""
        return replace(self, hp=replace(self.hp, max_episodes=min(episodes, self.hp.max_episodes)))

    def request(self, index: int, se: int | None = None) -> EvaluationRequest:
        """The evaluation, at that index among the requests of one call, which gets this unit's SE
        or (`se`) several, of which this is its number."""
        on: TrainedOn = Centre() if se is None else Given(se)
        return EvaluationRequest(
            index, self.seed, self.hp, RealTask() if self.source.se is None else on
        )


#: Results by the units' keys.
Found = dict[str, EvaluationResult]


class AgentResults:
    """The results of an experiment's agents, on disk as they come.

    Raises InvalidInput for a damaged file.
    """

    def __init__(self, folder: Path) -> None:
        self._log = JsonlLog(folder / RESULTS_FILE)
        self.found: Found = dict(_stored(self._log))
        self._folder = folder

    def add(self, unit: Unit, result: EvaluationResult) -> None:
        """Append a result; it counts once this returns. Raises StorageFailure."""
        self._append(unit.key, result)

    def adopt(self, units: Iterable[Unit]) -> None:
        """Copy the results that other experiments of the task have of these units; those that
        another version of this package has made are left alone."""
        missing = {unit.key for unit in units} - self.found.keys()
        if not missing:
            return
        for path in sorted(self._folder.parent.glob(f"experiment-*/{RESULTS_FILE}")):
            if path.parent == self._folder or not _of_this_version(path.parent):
                continue
            for key, result in _stored(JsonlLog(path)):
                if key in missing:
                    missing.discard(key)
                    self._append(key, result)

    def _append(self, key: str, result: EvaluationResult) -> None:
        self._log.append([key, asdict(result)])
        self.found[key] = result


def _of_this_version(folder: Path) -> bool:
    """Whether an experiment's folder has sound settings of this version's format."""
    try:
        read_settings(folder)
    except InvalidInput:
        return False
    return True


def _stored(log: JsonlLog) -> Iterator[tuple[str, EvaluationResult]]:
    yield from log.decoded(tuple[str, EvaluationResult])
