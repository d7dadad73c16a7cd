"""`bilevel evaluate`: fresh agents on SEs, or on the real task, tested on the real task.

for each source:                          # an SE file, or the real task
    for each kind of agent:
        for each of n agents:             # on the pool, in any order
            train it on the source, test it on the real task

Agent i has the same seed on every source, and the same draws of varied hyperparameters (paper,
section "Evaluation Performance of SE-trained Agents"). Other hyperparameters may depend on the
source: agents need more episodes where an episode has one step.
"""

import json
import time
from collections.abc import Callable, Container, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

from bilevel.agents.variation import draw_agent
from bilevel.durable import write_aside
from bilevel.evaluation import EvaluationRequest, EvaluationResult, Given, RealTask, TrainedOn
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import StoredSE
from bilevel.tasks import Task
from cluster.evaluate.report import Group, as_json, as_table, groups_of, picture
from cluster.evaluate.run import PICTURE_FILE, REPORT_FILE, RESULTS_FILE, EvaluationViews
from cluster.pictures import image
from cluster.ray.pool import EvaluationPool
from cluster.session.context import RunContext, Session
from cluster.session.terminal import count
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import Final, add_final, settings_of

_Key = TypeVar("_Key")


@dataclass(frozen=True)
class EvaluateCommand:
    """An evaluation of `agents` fresh agents of each kind on each source."""

    task: Task
    sources: dict[str, StoredSE | None]  # by label; None is the real task
    kinds: dict[str, tuple[AgentHyperparameters, ...]]  # by label; the same names on each source
    agents: int
    vary: str  # of VARIATIONS
    seed: int
    name: str
    context: RunContext
    workers: int | None = None  # actors; None: one per core of the cluster

    def settings(self) -> dict[str, Any]:
        """Return the settings that must stay the same on a resume, which may add agents."""
        return {
            **settings_of(EvaluationViews.kind, self.task, self.seed),
            "vary": self.vary,
            "sources": {
                label: "real" if se is None else se.se.digest for label, se in self.sources.items()
            },
            "kinds": {
                label: {hp.agent: asdict(hp) for hp in kinds} for label, kinds in self.kinds.items()
            },
        }

    @property
    def names(self) -> list[str]:
        """Names of the kinds of agents."""
        return [hp.agent for hp in next(iter(self.kinds.values()))]

    def agent(self, hp: AgentHyperparameters, i: int) -> tuple[AgentHyperparameters, int]:
        """Return hyperparameters and seed of agent `i` of a kind."""
        seed = derive(self.seed, Purpose.EVALUATION, i)
        return draw_agent((hp,), self.vary, seed), seed


def run_evaluate(command: EvaluateCommand) -> list[Group]:
    """Evaluate, report, and track; return the groups in the order of the table.

    Results are durable when they arrive, and the same command resumes. Raises InvalidInput before
    anything is written.
    """
    folder = command.context.home.run_folder(command.task.id, command.name)
    with (
        command.context.connected(command.workers or 1) as driver,
        EvaluationPool(command.workers) as pool,
        driver.session(folder, command.task.id, command.settings()) as session,
    ):
        session.introduce(
            f"{command.agents} fresh {', '.join(command.names)} agents on "
            f"{', '.join(command.sources)}, tested on {command.task.id}; "
            f"{count(pool.size, 'worker')}, seed {command.seed}"
        )
        views = EvaluationViews(folder, live=True)
        resume_hint = "run the same command again to add the missing agents"
        with session.live(views, command.agents, resume_hint):
            groups, log = _evaluate(command, session, pool), session.terminal.log
            log(as_table(groups))
            write_aside(folder / REPORT_FILE, json.dumps(as_json(groups), indent=2).encode())
            title = f"fresh agents of the evaluation\n{folder.name}"
            write_aside(folder / PICTURE_FILE, image(picture(groups, command.task, title)))
            # One metric per group: MLflow shows every metric of any run as a column of all runs.
            means = {
                f"test_return/{g.agent}/{g.source}": float(g.test_returns.mean()) for g in groups
            }
            add_final(folder, Final(command.agents, time.time(), means))
            log(f"report: {folder / REPORT_FILE}; picture: {folder / PICTURE_FILE}")
            log(f"MLflow {session.address}")
            return groups


def _evaluate(command: EvaluateCommand, session: Session, pool: EvaluationPool) -> list[Group]:
    """Evaluate the missing agents."""
    log = JsonlLog(session.folder / RESULTS_FILE)
    stored = log.decoded(tuple[str, str, int, EvaluationResult])
    results = {(label, agent, i): result for label, agent, i, result in stored}
    agents = {
        (label, hp.agent, i): (label, *command.agent(hp, i))
        for label in command.sources
        for hp in command.kinds[label]
        for i in range(command.agents)
    }

    def add(key: tuple[str, str, int], result: EvaluationResult) -> None:
        # The index among the requests of this call would differ after a resume.
        results[key] = replace(result, index=key[-1])
        log.append([*key, asdict(results[key])])

    train_agents(session, pool, command.task, command.sources, agents, results, add)
    grouped: dict[tuple[str, str], list[EvaluationResult]] = {}
    for label, agent, i in agents:
        grouped.setdefault((label, agent), []).append(results[label, agent, i])
    return groups_of(grouped, command.task.solved_reward)


def train_agents(
    session: Session,
    pool: EvaluationPool,
    task: Task,
    sources: Mapping[str, StoredSE | None],
    agents: Mapping[_Key, tuple[str, AgentHyperparameters, int]],
    found: Container[_Key],
    add: Callable[[_Key, EvaluationResult], None],
) -> None:
    """Train the agents that are not in `found`, given by source, hyperparameters and seed, and test
    them on the task. `add` stores a result.

    All sources are in one call, so that a slow agent leaves no core idle.
    """
    missing = [key for key in agents if key not in found]
    session.terminal.bar("training", len(agents) - len(missing), len(agents), "agents")

    def keep(result: EvaluationResult) -> None:
        session.guard.check()
        add(missing[result.index], result)
        session.terminal.step()

    ses = {label: se.se for label, se in sources.items() if se is not None}
    on: dict[str, TrainedOn] = {label: Given(number) for number, label in enumerate(ses)}
    requests = [
        EvaluationRequest(index, seed, hp, on.get(label, RealTask()))
        for index, (label, hp, seed) in enumerate(agents[key] for key in missing)
    ]
    pool.run(task, tuple(ses.values()), requests, keep)
