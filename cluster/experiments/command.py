"""`bilevel experiment`: make the SEs, train the agents, and draw what came out.

for each experiment:
    for each seed, for each condition:
        an NES run to its end                # shared by all experiments of the task
    until the experiment asks for no more:
        for each source that it asks for:    # an SE, or the real task
            train the agents on the pool, test them on the real task
    data, pictures, findings

Every NES run and every agent is on disk once it has ended, so the same command resumes, also on
another machine that the home was copied to. Data and pictures of an experiment that needs NES runs
alone are there before the last one has ended, and grow with each.
"""

import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from bilevel.durable import write_aside
from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import default_agents
from bilevel.tasks import Task
from cluster.experiments.agents import AgentResults, Unit
from cluster.experiments.conditions import title_of
from cluster.experiments.experiment import Experiment, Findings, Material, Plan, SERun, se_runs
from cluster.experiments.run import (
    DATA_FILE,
    FINDINGS_FILE,
    KIND,
    RUNS_FILE,
    StoredFindings,
    folder_name,
    versions,
)
from cluster.experiments.sizes import Size
from cluster.experiments.style import svg
from cluster.experiments.table import csv_bytes, text_lines
from cluster.experiments.view import ExperimentViews
from cluster.nes.command import run_on
from cluster.ray.pool import EvaluationPool
from cluster.session.context import Driver, RunContext
from cluster.session.session import Session
from cluster.session.terminal import count
from cluster.storage.author import Author
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import Final, add_final, check_settings, settings_of


@dataclass(frozen=True)
class ExperimentCommand:
    """Experiments on a task, and how and where this command runs them."""

    task: Task
    size: Size
    seed: int
    context: RunContext
    agents: tuple[str, ...] | None = None  # kinds of agents; None: each experiment's own
    workers: int | None = None  # actors; None: one per core of this run's share

    def plan(self, experiment: Experiment) -> Plan:
        """The experiment's subject. Raises InvalidInput."""
        names = self.agents or experiment.kinds(self.task)
        kinds = default_agents(names)
        return Plan(self.task, self.size, self.size.trained(kinds), self.seed)

    def name(self, experiment: str) -> str:
        """Name of an experiment's folder."""
        return folder_name(self.size.prefix, experiment, self.agents, self.seed)

    def settings(self, experiment: str, kinds: Mapping[str, Any]) -> dict[str, Any]:
        """What must stay the same when it is resumed; its size may change."""
        return {
            **settings_of(KIND, self.task, self.seed, kinds),
            "experiment": experiment,
            "kinds": kinds,
        }


def run_experiments(command: ExperimentCommand, experiments: Sequence[Experiment]) -> None:
    """Run or resume the experiments, one after the other.

    Raises InvalidInput before anything is written, StorageFailure if the disk is full. Ctrl-C
    loses at most a generation, or the agents that are being trained.
    """
    plans = [command.plan(experiment) for experiment in experiments]
    home, task = command.context.home, command.task
    folders = [home.run_folder(task.id, command.name(one.name)) for one in experiments]
    with (
        command.context.connected(command.workers or 1) as driver,
        EvaluationPool.on_cluster(command.workers) as pool,
    ):
        for experiment, plan, folder in zip(experiments, plans, folders, strict=True):
            kinds = {hp.agent: asdict(hp) for hp in plan.kinds}
            settings = command.settings(experiment.name, kinds)
            with driver.session(folder, task.id, settings) as session:
                _Runner(experiment, plan, driver, session, pool).run()


class _Runner:
    """Runs one experiment."""

    def __init__(
        self,
        experiment: Experiment,
        plan: Plan,
        driver: Driver,
        session: Session,
        pool: EvaluationPool,
    ) -> None:
        self.experiment = experiment
        self.plan = plan
        self.driver = driver
        self.session = session
        self.terminal = session.terminal
        self.folder = session.folder
        self.pool = pool
        runs, size = experiment.runs(plan.size), plan.size
        self.ses = se_runs(runs, plan.task, size, plan.seed, driver.context.home)

    def run(self) -> Findings:
        """Make the SEs and agents that are missing, then report."""
        plan, experiment = self.plan, self.experiment
        kinds = ", ".join(hp.agent for hp in plan.kinds)
        self.session.introduce(
            f"experiment {experiment.name} on {plan.task.id}: {count(len(self.ses), 'NES run')}, "
            f"agents {kinds}, size {plan.size.name}, {count(self.pool.size, 'worker')}, "
            f"seed {plan.seed}"
        )
        views = ExperimentViews(self.folder, self.session.identity, live=True)
        resume_hint = "run the same command again to resume after the last NES run or agent"
        with self.session.live(views, len(self.ses), resume_hint):
            self._make_ses()
            results = AgentResults(self.folder)
            material = self._material(self.ses, results)
            self._train(material, results)
            if experiment.record is not None:
                self.terminal.log("recording agents in their readable form, on one core")
                experiment.record(plan, material, self._recorded)
            findings = experiment.conclude(plan, material)
            self._write(findings, material)
            self._report(findings, len(results.found))
            return findings

    def _material(self, ses: Sequence[SERun], results: AgentResults) -> Material:
        """What has been gathered on these SEs, which have ended."""
        return Material(ses, [made.source for made in ses], results.found, self.folder)

    def _make_ses(self) -> None:
        """Run NES to its end for every SE that is not there yet."""
        log = JsonlLog(self.folder / RUNS_FILE)
        by_seed = sorted(self.ses, key=lambda made: made.number)  # so conditions grow alike
        for number, made in enumerate(by_seed, start=1):
            self.session.guard.check()
            run = made.run
            if run.ended:
                check_settings(run.folder, run.settings())
            else:
                if self.experiment.interim:
                    self._conclude_so_far()
                self.terminal.log(
                    f"NES run {number} of {len(self.ses)}: {title_of(made.condition)}, "
                    f"seed {run.seed}"
                )
                run_on(run, self.driver, self.pool)
            if run.folder.name not in log.values:
                log.append(run.folder.name)

    def _conclude_so_far(self) -> None:
        """Write what the NES runs tell that have ended."""
        ended = [made for made in self.ses if made.run.ended]
        if ended:
            material = self._material(ended, AgentResults(self.folder))
            self._write(self.experiment.conclude(self.plan, material), material)

    def _train(self, material: Material, results: AgentResults) -> None:
        """Train the agents that the experiment asks for until it asks for no more."""
        while True:
            # By key: the same agent on equal SEs is asked for twice, and trained once.
            units = {unit.key: unit for unit in self.experiment.units(self.plan, material)}
            results.adopt(units.values())
            missing = [unit for key, unit in units.items() if key not in results.found]
            if not missing:
                return
            self._train_all(missing, len(units), results)

    def _train_all(self, missing: Sequence[Unit], total: int, results: AgentResults) -> None:
        """Train the missing ones of so many agents, those on all SEs at a time: a long one then
        keeps no core waiting."""
        ses = {unit.source.digest: unit.source.se for unit in missing if unit.source.se is not None}
        numbers = {digest: number for number, digest in enumerate(ses)}
        requests = [
            unit.request(index, numbers.get(unit.source.digest, 0))
            for index, unit in enumerate(missing)
        ]
        started, costs = time.monotonic(), [unit.hp.step_cost for unit in missing]
        trained: list[float] = []  # costs of steps

        def show() -> None:
            left = sum(costs) - sum(trained)
            seconds = (time.monotonic() - started) * left / max(sum(trained), 1.0)
            # How long the last ones take, which all run now, their sizes do not tell.
            known = trained and len(missing) - len(trained) > self.pool.size
            done = total - len(missing) + len(trained)
            self.terminal.bar("training", done, total, "agents", eta=seconds if known else 0.0)

        def keep(result: EvaluationResult) -> None:
            self.session.guard.check()
            results.add(missing[result.index], result)
            trained.append(costs[result.index])
            show()

        show()
        self.pool.run(self.plan.task, tuple(se.se for se in ses.values()), requests, keep)

    def _recorded(self, done: int, total: int) -> None:
        self.session.guard.check()
        self.terminal.bar("recording", done, total, "agents")

    def _write(self, findings: Findings, material: Material) -> None:
        """Write data, pictures and findings."""
        pictures = {f"{name}.svg": figure for name, figure in findings.figures.items()}
        for name, figure in pictures.items():
            write_aside(self.folder / name, svg(figure))
        write_aside(self.folder / DATA_FILE, csv_bytes(findings.data))
        author = Author.of_this_process()
        stored = StoredFindings(
            self.experiment.name,
            self.plan.size,
            dict(Counter(made.condition for made in material.ses)),
            tuple(pictures),
            tuple(dict(row) for row in findings.summary),
            tuple(findings.notes),
            versions(),
            author.command,
            author.commit,
        )
        write_aside(self.folder / FINDINGS_FILE, json.dumps(asdict(stored), indent=2).encode())

    def _report(self, findings: Findings, agents: int) -> None:
        """Tell the findings, also to MLflow."""
        for row in text_lines(findings.summary):
            self.terminal.log(row)
        add_final(self.folder, Final(len(self.ses) + agents, time.time(), dict(findings.metrics)))
        log = self.terminal.log
        pictures = count(len(findings.figures), "picture")
        log(f"data: {self.folder / DATA_FILE}; {pictures} in the same folder")
        log(f"MLflow {self.session.shown_at(self.session.identity.uuid)}")
