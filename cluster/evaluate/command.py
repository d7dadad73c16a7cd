"""`bilevel evaluate`: fresh agents on SEs, or on the real task, tested on the real task.

for each source:                          # an SE file, or the real task
    for each kind of agent:
        for each of n agents:             # on the pool, in any order
            train it on the source, test it on the real task

Agent i has the same seed, and with varied hyperparameters the same draw, on every
source, so that sources are compared on the same agents (paper, section "Evaluation
Performance of SE-trained Agents").
"""

import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from bilevel.agents.variation import draw_agent
from bilevel.durable import write_aside
from bilevel.evaluation import (
    EvaluationRequest,
    EvaluationResult,
    Given,
    RealTask,
    TrainedOn,
)
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import StoredSE
from bilevel.tasks import Task
from cluster.evaluate import pictures
from cluster.evaluate.report import Group, as_json, as_table, groups_of
from cluster.evaluate.run import KIND, PICTURE_FILE, REPORT_FILE, RESULTS_FILE
from cluster.evaluate.view import EvaluationViews
from cluster.pictures import png
from cluster.ray.pool import EvaluationPool
from cluster.session.context import RunContext
from cluster.session.session import Session
from cluster.session.terminal import count
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import Final, add_final, settings_of


@dataclass(frozen=True)
class EvaluateCommand:
    """An evaluation of `agents` fresh agents of each kind on each source."""

    task: Task
    sources: dict[str, StoredSE | None]  # by label; None is the real task
    kinds: tuple[AgentHyperparameters, ...]
    agents: int
    vary: str  # of VARIATIONS
    seed: int
    name: str
    context: RunContext
    workers: int | None = None  # actors; None: one a core of the run's share

    def settings(self) -> dict[str, Any]:
        """Settings that must stay the same when it is resumed; more agents may be added."""
        return {
            **settings_of(KIND, self.task, self.seed, [hp.agent for hp in self.kinds]),
            "vary": self.vary,
            "sources": {
                label: "real" if se is None else se.se.digest for label, se in self.sources.items()
            },
            "kinds": {hp.agent: asdict(hp) for hp in self.kinds},
        }

    def request(
        self, index: int, hp: AgentHyperparameters, i: int, on: TrainedOn
    ) -> EvaluationRequest:
        """Agent `i` of a kind, at that index among the requests of one call."""
        # One word both draws the agent and trains it, unlike in `fresh_agent`: kept, so that
        # evaluations of earlier versions can be resumed.
        word = derive(self.seed, Purpose.EVALUATION, i)
        return EvaluationRequest(index, word, draw_agent((hp,), self.vary, word), on)


def run_evaluate(command: EvaluateCommand) -> list[Group]:
    """Evaluate, report, and track; returns the groups in the order of the table.

    Results are on disk as they come: the same command again resumes. Raises
    InvalidInput before anything is written.
    """
    folder = command.context.home.run_folder(command.task.id, command.name)
    with (
        command.context.connected(command.workers or 1) as driver,
        EvaluationPool.on_cluster(command.workers) as pool,
        driver.session(folder, command.task.id, command.settings()) as session,
    ):
        return _Runner(command, session, pool).run()


class _Runner:
    """Runs one evaluation."""

    def __init__(self, command: EvaluateCommand, session: Session, pool: EvaluationPool) -> None:
        self.command = command
        self.session = session
        self.terminal = session.terminal
        self.folder = session.folder
        self.pool = pool

    def run(self) -> list[Group]:
        """Evaluate the agents that are missing, then report."""
        command = self.command
        self.session.introduce(
            f"{command.agents} fresh {_list(hp.agent for hp in command.kinds)} agents on "
            f"{_list(command.sources)}, tested on {command.task.id}; "
            f"{count(self.pool.size, 'worker')}, seed {command.seed}"
        )
        views = EvaluationViews(self.folder, self.session.identity, live=True)
        resume_hint = "run the same command again to add the missing agents"
        with self.session.live(views, command.agents, resume_hint):
            groups = self._groups()
            self._report(groups)
            return groups

    def _groups(self) -> list[Group]:
        command = self.command
        file = JsonlLog(self.folder / RESULTS_FILE)
        results = dict(self._stored(file))
        total = len(command.sources) * len(command.kinds) * command.agents
        self.terminal.bar("evaluating", len(results), total, "agents")
        # All sources at a time: a long evaluation then keeps no core waiting.
        ses = {label: se.se for label, se in command.sources.items() if se is not None}
        on: dict[str, TrainedOn] = {label: Given(number) for number, label in enumerate(ses)}
        missing = [
            (label, hp, i)
            for label in command.sources
            for hp in command.kinds
            for i in range(command.agents)
            if (label, hp.agent, i) not in results
        ]
        requests = [
            command.request(index, hp, i, on.get(label, RealTask()))
            for index, (label, hp, i) in enumerate(missing)
        ]

        def keep(result: EvaluationResult) -> None:
            label, hp, i = missing[result.index]
            # Stored under its own number, whatever was asked for beside it.
            results[label, hp.agent, i] = replace(result, index=i)
            file.append([label, hp.agent, i, asdict(results[label, hp.agent, i])])
            self.terminal.step()

        self.pool.run(command.task, tuple(ses.values()), requests, keep)
        return groups_of(
            {
                (label, hp.agent): [results[label, hp.agent, i] for i in range(command.agents)]
                for label in command.sources
                for hp in command.kinds
            },
            command.task.solved_reward,
        )

    def _stored(self, file: JsonlLog) -> Iterator[tuple[tuple[str, str, int], EvaluationResult]]:
        """Results of earlier calls. Raises InvalidInput if damaged."""
        for label, agent, i, result in file.decoded(tuple[str, str, int, EvaluationResult]):
            if label in self.command.sources and i < self.command.agents:
                yield (label, agent, i), result

    def _report(self, groups: list[Group]) -> None:
        log = self.terminal.log
        for row in as_table(groups):
            log(row)
        report = as_json(groups)
        write_aside(self.folder / REPORT_FILE, json.dumps(report, indent=2).encode())
        title = f"fresh agents of the evaluation\n{self.folder.name}"
        write_aside(
            self.folder / PICTURE_FILE,
            png(pictures.returns(groups, self.command.task, title)),
        )
        # One metric a group: MLflow offers every metric of any run as a column of all runs.
        metrics = {
            f"test_return/{group.agent}/{group.source}": group.summary()["test_returns_mean"]
            for group in groups
        }
        add_final(self.folder, Final(self.command.agents, time.time(), metrics))
        log(f"report: {self.folder / REPORT_FILE}; picture: {self.folder / PICTURE_FILE}")
        log(f"MLflow {self.session.shown_at(self.session.identity.uuid)}")


def _list(names: Any) -> str:
    return ", ".join(names)
