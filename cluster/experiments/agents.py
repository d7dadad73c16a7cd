"""Evaluations of the experiments: which agent trains on which source, and their results.

An evaluation is a pure function of its request. Results are therefore stored under a digest of the
request, and experiments and sizes share them.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from bilevel.agents import get_agent
from bilevel.durable import checksum
from bilevel.errors import InvalidInput
from bilevel.evaluation import EvaluationRequest, EvaluationResult, Given, RealTask
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.nes import NESState
from bilevel.nes.requests import fresh_agent
from bilevel.seeds import Purpose
from bilevel.synthetic_env import StoredSE, load_se
from bilevel.tasks import Task
from cluster.experiments.conditions import REAL
from cluster.experiments.run import RESULTS_FILE
from cluster.experiments.sizes import AGENTS, Size
from cluster.nes.run import NESRun
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import BEST_FILE

#: Characters of a digest that are kept.
_DIGEST = 32


@dataclass(frozen=True)
class Plan:
    """Subject of an experiment: task, size, kinds of agents, and the seed of everything."""

    task: Task
    size: Size
    kinds: tuple[AgentHyperparameters, ...]  # with the training episodes of this size
    seed: int


@dataclass(frozen=True)
class Source:
    """Training environment of agents: the SE of a condition's NES run, or the real task."""

    condition: str  # REAL for the real task
    number: int = 0  # of the condition's run
    se: StoredSE | None = None  # None: the real task
    run: NESRun | None = None  # which has finished

    @classmethod
    def of_run(cls, condition: str, number: int, run: NESRun) -> "Source":
        """Load the SE of a finished run. Raises InvalidInput if its file is damaged."""
        return cls(condition, number, load_se(run.folder / BEST_FILE), run)

    @property
    def state(self) -> NESState:
        """The last state of the run. Raises InvalidInput if its file is damaged or missing."""
        assert self.run is not None
        state = self.run.load()
        if state is None:
            raise InvalidInput(f"{str(self.run.folder)!r} has no checkpoint")
        return state

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
        return checksum(json.dumps(facts, sort_keys=True).encode())[:_DIGEST]

    def shorter(self, episodes: int) -> "Evaluation":
        """Return the same agent with at most that many training episodes."""
        return replace(self, hp=replace(self.hp, max_episodes=min(episodes, self.hp.max_episodes)))

    def request(self, index: int, se: int = 0) -> EvaluationRequest:
        """Return the request at `index` of a call that gets several SEs, of which number `se` is
        this evaluation's."""
        on = RealTask() if self.source.se is None else Given(se)
        return EvaluationRequest(index, self.seed, self.hp, on)


def evaluations_on(
    plan: Plan,
    sources: Iterable[Source],
    kinds: Iterable[AgentHyperparameters],
    agents: int,
    on_real: int = 0,
    per_se: int = AGENTS,
    vary: str = "all",
) -> list[Evaluation]:
    """Return `agents` agents of each kind on each SE, and `on_real` of each kind on the real task.

    Seed and hyperparameters, which are drawn according to `vary`, depend on the position alone.
    The agents on the real task have the positions of `per_se` agents on each of several SEs.
    """
    found = []
    for source in sources:
        on_se = [(source.number, agent) for agent in range(agents)]
        on_task = [divmod(number, per_se) for number in range(on_real)]
        for kind in kinds:
            for se, agent in on_task if source.se is None else on_se:
                seed, hp = fresh_agent((kind,), vary, plan.seed, Purpose.EXPERIMENT, se, agent)
                found.append(Evaluation(plan.task, source, f"{se}-{agent}", hp, seed))
    return found


#: Results by the keys of the evaluations.
Found = dict[str, EvaluationResult]


class AgentResults:
    """Durable results of an experiment's agents.

    Raises InvalidInput for a damaged file.
    """

    def __init__(self, folder: Path) -> None:
        self._log = JsonlLog(folder / RESULTS_FILE)
        self._folder = folder
        self.found: Found = dict(self._log.decoded(tuple[str, EvaluationResult]))

    def add(self, key: str, result: EvaluationResult) -> None:
        """Append a result. Raises StorageFailure."""
        self._log.append([key, asdict(result)])
        self.found[key] = result

    def adopt(self, keys: Iterable[str]) -> None:
        """Copy the results with these keys from other experiments of the task."""
        missing = {*keys} - self.found.keys()
        if not missing:
            return
        for path in sorted(self._folder.parent.glob(f"experiment-*/{RESULTS_FILE}")):
            for key, result in JsonlLog(path).decoded(tuple[str, EvaluationResult]):
                if key in missing:
                    missing.remove(key)
                    self.add(key, result)
