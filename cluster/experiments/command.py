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
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

from bilevel.durable import write_aside
from bilevel.hyperparameters import default_agents
from bilevel.synthetic_env import load_se
from bilevel.tasks import Task
from bilevel.version import __version__
from cluster.evaluate.command import train_agents
from cluster.evaluate.report import table
from cluster.experiments.conditions import title_of
from cluster.experiments.experiment import Experiment, Findings, Material, Plan, Source
from cluster.experiments.run import (
    DATA_FILE,
    FINDINGS_FILE,
    RUNS_FILE,
    AgentResults,
    ExperimentViews,
    StoredFindings,
)
from cluster.experiments.sizes import Size
from cluster.experiments.style import svg
from cluster.nes.command import run_on
from cluster.nes.run import NESRun
from cluster.ray.pool import EvaluationPool
from cluster.session.context import Driver, RunContext, Session
from cluster.session.terminal import count
from cluster.storage.author import Author
from cluster.storage.jsonl_log import JsonlLog
from cluster.storage.run_folder import BEST_FILE, Final, add_final, check_settings, settings_of

#: Packages that results may depend on.
_PACKAGES = ("numpy", "numba", "scipy", "torch", "gymnasium", "ray", "mlflow", "matplotlib")


@dataclass(frozen=True)
class ExperimentCommand:
    """Experiments on a task, and how and where to run them."""

    task: Task
    size: Size
    seed: int
    context: RunContext
    agents: tuple[str, ...] | None = None  # kinds of agents; None: each experiment's own
    workers: int | None = None  # actors; None: one per core of the cluster

    def name(self, experiment: str) -> str:
        """Return the name of an experiment's folder."""
        named = "".join(f"-{agent}" for agent in self.agents or ())
        return f"{self.size.prefix}{experiment}{named}-seed{self.seed}"

    def settings(self, experiment: str, kinds: Mapping[str, Any]) -> dict[str, Any]:
        """Return what must stay the same on a resume; the size may change."""
        own = {"experiment": experiment, "kinds": kinds}
        return settings_of(ExperimentViews.kind, self.task, self.seed) | own


def run_experiments(command: ExperimentCommand, experiments: Sequence[Experiment]) -> None:
    """Run or resume the experiments, one after the other.

    Raises InvalidInput before anything is written, StorageFailure if the disk is full. Ctrl-C
    loses at most a generation, or the agents that are being trained.
    """
    home, task, size = command.context.home, command.task, command.size
    kinds = [default_agents(command.agents or one.agents(task.id)) for one in experiments]
    plans = [Plan(task, size, size.trained(agents), command.seed) for agents in kinds]
    with (
        command.context.connected(command.workers or 1) as driver,
        EvaluationPool(command.workers) as pool,
    ):
        for experiment, plan in zip(experiments, plans, strict=True):
            settings = command.settings(
                experiment.name, {hp.agent: asdict(hp) for hp in plan.kinds}
            )
            folder = home.run_folder(task.id, command.name(experiment.name))
            with driver.session(folder, task.id, settings) as session:
                _Runner(experiment, plan, driver, session, pool).run()


@dataclass(frozen=True)
class _Runner:
    """Runs one experiment."""

    experiment: Experiment
    plan: Plan
    driver: Driver
    session: Session
    pool: EvaluationPool

    def run(self) -> None:
        """Make the missing SEs and agents, then report."""
        plan, experiment, session = self.plan, self.experiment, self.session
        runs = plan.runs(experiment, self.driver.context.home)
        session.introduce(
            f"experiment {experiment.name} on {plan.task.id}: {count(len(runs), 'NES run')}, "
            f"agents {', '.join(hp.agent for hp in plan.kinds)}, size {plan.size.name}, "
            f"{count(self.pool.size, 'worker')}, seed {plan.seed}"
        )
        views = ExperimentViews(session.folder, live=True)
        resume_hint = "run the same command again to resume after the last NES run or agent"
        with session.live(views, len(runs), resume_hint):
            self._finish(runs)
            results = AgentResults(session.folder)
            sources = [
                Source(*place, load_se(run.folder / BEST_FILE), run) for place, run in runs.items()
            ]
            material = Material(sources, results.found, self._recorded)
            self._train(material, results)
            findings = experiment.conclude(plan, material)
            self._write(findings)
            metrics, done = dict(findings.metrics), len(runs) + len(results.found)
            add_final(session.folder, Final(done, time.time(), metrics))
            session.terminal.log(table(findings.summary).to_string(index=False))
            session.terminal.log(f"data and pictures: {session.folder}")
            session.terminal.log(f"MLflow {session.address}")

    def _finish(self, runs: Mapping[tuple[str, int], NESRun]) -> None:
        """Finish the NES run of every SE, seed by seed."""
        log = JsonlLog(self.session.folder / RUNS_FILE)
        ordered = sorted(runs.items(), key=lambda item: item[0][1])
        for number, ((condition, _), run) in enumerate(ordered, start=1):
            self.session.guard.check()
            if run.ended:
                check_settings(run.folder, run.settings())
            else:
                self.session.terminal.log(
                    f"NES run {number} of {len(runs)}: {title_of(condition)}, seed {run.seed}"
                )
                run_on(run, self.driver, self.pool)
            if run.folder.name not in log.values:
                log.append(run.folder.name)

    def _train(self, material: Material, results: AgentResults) -> None:
        """Train agents until the experiment needs no more."""
        while True:
            # Equal agents on equal SEs have the same key and are trained once.
            needed = {one.key: one for one in self.experiment.evaluations(self.plan, material)}
            results.adopt(needed)
            if needed.keys() <= results.found.keys():
                return
            sources = {one.source.digest: one.source.se for one in needed.values()}
            agents = {key: (one.source.digest, one.hp, one.seed) for key, one in needed.items()}
            session, task, add = self.session, self.plan.task, results.add
            train_agents(session, self.pool, task, sources, agents, results.found, add)

    def _recorded(self, done: int, total: int) -> None:
        self.session.guard.check()
        self.session.terminal.bar("recording", done, total, "agents")

    def _write(self, findings: Findings) -> None:
        """Write data, pictures and findings."""
        folder = self.session.folder
        for name, figure in findings.figures.items():
            write_aside(folder / f"{name}.svg", svg(figure))
        data: str = findings.data.to_csv(index=False, lineterminator="\n")
        write_aside(folder / DATA_FILE, data.encode())
        author = Author.of_this_process()
        packages = {package: version(package) for package in _PACKAGES}
        stored = StoredFindings(
            self.experiment.name,
            self.plan.size,
            self.experiment.runs(self.plan.size),
            tuple(f"{name}.svg" for name in findings.figures),
            tuple(dict(row) for row in findings.summary),
            tuple(findings.notes),
            {"bilevel": __version__, "python": platform.python_version(), **packages},
            author.command,
            author.commit,
        )
        write_aside(folder / FINDINGS_FILE, json.dumps(asdict(stored), indent=2).encode())
