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
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.storage import write_aside
from bilevel.tasks import Task
from cluster.evaluation_report import Group, as_json, as_table, violins
from cluster.home import Home, locked_settings
from cluster.pool import EvaluationPool, placed_pool
from cluster.progress import Terminal
from cluster.ray_cluster import cluster_cores, ray_cluster, require_capacity
from cluster.tracking import Tracker
from cluster.tracking.tracker import check_tracking_uri
from search_spaces import draw_agent

#: Names the seeds apart from all others that a run derives.
_EVALUATE = 0x4556_414C

RESULTS_FILE, REPORT_FILE, PICTURE_FILE = "results.jsonl", "report.json", "violins.png"


@dataclass(frozen=True)
class EvaluateCommand:
    """What is evaluated: `agents` fresh ones of each kind, on each source."""

    task: Task
    sources: dict[str, StoredSE | None]  # by label; None is the real task
    kinds: tuple[AgentHyperparameters, ...]
    agents: int
    vary: bool
    seed: int
    name: str
    home: Home
    tracking_uri: str
    workers: int | None = None  # actors; None: one a core of the cluster
    address: str | None = None

    def settings(self) -> dict[str, Any]:
        """What must stay the same when it is continued; more agents may be added."""
        return {
            "task": self.task.id,
            "seed": self.seed,
            "vary": self.vary,
            "sources": {
                label: "real" if se is None else se.digest for label, se in self.sources.items()
            },
            "kinds": {hp.agent: asdict(hp) for hp in self.kinds},
        }


def run_evaluate(command: EvaluateCommand) -> list[Group]:
    """Evaluate, report, and track; returns the groups in the order of the table.

    Results are on disk as they come: the same command again goes on. Raises
    InvalidInput before anything is written.
    """
    folder = command.home.run_folder(command.task.id, command.name)
    check_tracking_uri(command.tracking_uri)
    with Terminal() as terminal, ray_cluster(command.address):
        workers = command.workers or cluster_cores()
        require_capacity(workers)
        command.home.prepare()
        with placed_pool(workers) as pool:
            tracker = Tracker(command.tracking_uri, command.task.id, command.home.artifacts)
            with locked_settings(folder, command.settings()) as identity:
                return _Evaluation(command, folder, pool, tracker, terminal).go(identity)


@dataclass
class _Evaluation:
    """An evaluation under way."""

    command: EvaluateCommand
    folder: Path
    pool: EvaluationPool
    tracker: Tracker
    terminal: Terminal

    def go(self, identity: str) -> list[Group]:
        """From what is on disk to the report, under the run `identity` in MLflow."""
        command, line = self.command, self.terminal.line
        kinds = {hp.agent: asdict(hp) for hp in command.kinds}
        run_id = self.tracker.open_run(
            identity,
            command.name,
            {"agents": kinds, "vary": command.vary, "seed": command.seed, "task": command.task.id},
            {"bilevel.kind": "evaluate"},
            description=f"{command.agents} fresh agents of each kind on {_list(command.sources)}, "
            f"tested on {command.task.id}.",
        )
        line(
            f"{command.agents} fresh {_list(kinds)} agents on {_list(command.sources)}, tested on "
            f"{command.task.id}; {self.pool.size} worker(s), seed {command.seed}"
        )
        line(f"folder {self.folder}; to look at it: {self.tracker.address}")
        status = "KILLED"
        try:
            groups = self._groups()
            self._report(groups, run_id)
            status = "FINISHED"
            return groups
        except KeyboardInterrupt:
            line("stopped; the same command goes on with the agents that are missing")
            raise
        except Exception:
            status = "FAILED"
            raise
        finally:
            self.tracker.close_run(run_id, status)

    def _groups(self) -> list[Group]:
        command = self.command
        results = dict(self._stored())
        total = len(command.sources) * len(command.kinds) * command.agents
        self.terminal.bar("evaluating", len(results), total, "agents")
        path = self.folder / RESULTS_FILE
        with path.open("a") as file:
            for label, se in command.sources.items():
                requests = {
                    (label, hp.agent, i): self._request(hp, i, se is None)
                    for hp in command.kinds
                    for i in range(command.agents)
                }
                missing = [key for key in requests if key not in results]

                def keep(
                    result: EvaluationResult, keys: list[tuple[str, str, int]] = missing
                ) -> None:
                    key = keys[result.index]
                    results[key] = result
                    file.write(json.dumps([*key, asdict(result)]) + "\n")
                    file.flush()
                    self.terminal.step()

                numbered = [
                    EvaluationRequest(**{**vars(requests[key]), "index": place})
                    for place, key in enumerate(missing)
                ]
                architecture = se.architecture if se else None
                psi = se.psi if se else None
                self.pool.run(command.task, architecture, psi, numbered, keep)
        return [
            Group(
                label,
                hp.agent,
                command.task.solved_reward,
                tuple(results[label, hp.agent, i] for i in range(command.agents)),
            )
            for label in command.sources
            for hp in command.kinds
        ]

    def _request(self, hp: AgentHyperparameters, i: int, real: bool) -> EvaluationRequest:
        seed = np.random.SeedSequence([self.command.seed, _EVALUATE, i])
        word = int(seed.generate_state(1, np.uint64)[0])
        return EvaluationRequest(i, word, draw_agent((hp,), self.command.vary, word), real=real)

    def _stored(self) -> Iterator[tuple[tuple[str, str, int], EvaluationResult]]:
        """What an earlier call has left; a line cut short by a crash is run again, and
        cut off, so that the next line begins on its own."""
        path = self.folder / RESULTS_FILE
        if not path.exists():
            return
        whole = b""
        for line in path.read_bytes().splitlines(keepends=True):
            try:
                label, agent, i, fields = json.loads(line)
                fields["test_returns"] = tuple(fields["test_returns"])
                result = EvaluationResult(**fields)
            except (ValueError, TypeError, KeyError):
                continue
            if line.endswith(b"\n"):
                whole += line
                if label in self.command.sources and i < self.command.agents:
                    yield (label, agent, i), result
        write_aside(path, whole)

    def _report(self, groups: list[Group], run_id: str) -> None:
        line = self.terminal.line
        for row in as_table(groups):
            line(row)
        report = as_json(groups)
        write_aside(self.folder / REPORT_FILE, json.dumps(report, indent=2).encode())
        figure = violins(groups, self.command.task)
        figure.savefig(self.folder / PICTURE_FILE, dpi=150)
        for group in groups:
            prefix = "" if len(groups) == 1 else f"{group.agent}/{group.source}/"
            values = {prefix + name: value for name, value in group.summary().items()}
            self.tracker.log_metrics(run_id, values, 0)
        for name in (REPORT_FILE, PICTURE_FILE, RESULTS_FILE):
            self.tracker.log_file(run_id, self.folder / name)
        line(f"report: {self.folder / REPORT_FILE}; picture: {self.folder / PICTURE_FILE}")


def _list(names: Any) -> str:
    return ", ".join(names)
