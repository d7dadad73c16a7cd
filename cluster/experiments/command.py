"""`bilevel experiment`: learn the SEs, train the agents, and write the findings.

for each experiment:
    for each seed, for each condition:
        finish an NES run                    # shared by all experiments of the task
    until the experiment needs no more evaluations:
        for each source:                     # an SE, or the real task
            train agents on the pool, test them on the real task
    write data, pictures and findings

Every NES run and every agent is durable when it finishes, so the same command resumes, also on
another machine that has a copy of the home.
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
from cluster.experiments.agents import AgentResults, Evaluation, Plan
from cluster.experiments.conditions import title_of
from cluster.experiments.experiment import Experiment, Findings, Material, se_runs
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
from cluster.experiments.table import table
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
    """Experiments on a task, and how and where to run them."""

    task: Task
    size: Size
    seed: int
    context: RunContext
    agents: tuple[str, ...] | None = None  # kinds of agents; None: each experiment's own
    workers: int | None = None  # actors; None: one per core of this run's share

    def plan(self, experiment: Experiment) -> Plan:
        """Return the experiment's subject. Raises InvalidInput."""
        kinds = default_agents(self.agents or experiment.agents(self.task.id))
        return Plan(self.task, self.size, self.size.trained(kinds), self.seed)

    def name(self, experiment: str) -> str:
        """Return the name of an experiment's folder."""
        return folder_name(self.size.prefix, experiment, self.agents, self.seed)

    def settings(self, experiment: str, kinds: Mapping[str, Any]) -> dict[str, Any]:
        """Return what must stay the same on a resume; the size may change."""
        settings = settings_of(KIND, self.task, self.seed, kinds)
        return {**settings, "experiment": experiment, "kinds": kinds}


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
        self.ses = se_runs(
            experiment.runs(plan.size), plan.task, plan.size, plan.seed, driver.context.home
        )

    def run(self) -> None:
        """Make the missing SEs and agents, then report."""
        plan, experiment = self.plan, self.experiment
        self.session.introduce(
            f"experiment {experiment.name} on {plan.task.id}: {count(len(self.ses), 'NES run')}, "
            f"agents {', '.join(hp.agent for hp in plan.kinds)}, size {plan.size.name}, "
            f"{count(self.pool.size, 'worker')}, seed {plan.seed}"
        )
        views = ExperimentViews(self.folder, self.session.identity, live=True)
        resume_hint = "run the same command again to resume after the last NES run or agent"
        with self.session.live(views, len(self.ses), resume_hint):
            self._make_ses()
            results = AgentResults(self.folder)
            material = Material.of(self.ses, results.found, self.folder, self._recorded)
            self._train(material, results)
            findings = experiment.conclude(plan, material)
            self._write(findings, material)
            self._report(findings, len(results.found))

    def _make_ses(self) -> None:
        """Finish the NES run of every SE, seed by seed, so that all conditions grow alike."""
        log = JsonlLog(self.folder / RUNS_FILE)
        ordered = sorted(self.ses, key=lambda made: made.number)
        for number, made in enumerate(ordered, start=1):
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
        """Write the findings on the finished NES runs."""
        finished = [made for made in self.ses if made.run.ended]
        if finished:
            material = Material.of(finished, {}, self.folder)
            self._write(self.experiment.conclude(self.plan, material), material)

    def _train(self, material: Material, results: AgentResults) -> None:
        """Train agents until the experiment needs no more."""
        while True:
            # Equal agents on equal SEs have the same key and are trained once.
            needed = {one.key: one for one in self.experiment.evaluations(self.plan, material)}
            results.adopt([*needed.values()])
            missing = [one for key, one in needed.items() if key not in results.found]
            if not missing:
                return
            self.terminal.bar("training", len(needed) - len(missing), len(needed), "agents")
            self._evaluate(missing, results)

    def _evaluate(self, missing: Sequence[Evaluation], results: AgentResults) -> None:
        """Run the evaluations on all SEs in one call, so that a slow one leaves no core idle."""
        ses = {one.source.digest: one.source.se for one in missing if one.source.se is not None}
        numbers = {digest: number for number, digest in enumerate(ses)}
        requests = [
            evaluation.request(index, numbers.get(evaluation.source.digest, 0))
            for index, evaluation in enumerate(missing)
        ]

        def keep(result: EvaluationResult) -> None:
            self.session.guard.check()
            results.add(missing[result.index].key, result)
            self.terminal.step()

        self.pool.run(self.plan.task, tuple(se.se for se in ses.values()), requests, keep)

    def _recorded(self, done: int, total: int) -> None:
        self.session.guard.check()
        self.terminal.bar("recording", done, total, "agents")

    def _write(self, findings: Findings, material: Material) -> None:
        """Write data, pictures and findings."""
        pictures = {f"{name}.svg": figure for name, figure in findings.figures.items()}
        for name, figure in pictures.items():
            write_aside(self.folder / name, svg(figure))
        data: str = findings.data.to_csv(index=False, lineterminator="\n")
        write_aside(self.folder / DATA_FILE, data.encode())
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
        """Print the findings and log the metrics to MLflow."""
        log = self.terminal.log
        for line in table(findings.summary).to_string(index=False).splitlines():
            log(line)
        add_final(self.folder, Final(len(self.ses) + agents, time.time(), dict(findings.metrics)))
        pictures = count(len(findings.figures), "picture")
        log(f"data: {self.folder / DATA_FILE}; {pictures} in the same folder")
        log(f"MLflow {self.session.shown_at(self.session.identity.uuid)}")
