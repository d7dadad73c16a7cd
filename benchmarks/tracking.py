"""CPU time that tracking costs the driver as a study grows.

    python -m benchmarks.tracking

The study runs BOHB and NES, but scores are made up. The record of each generation takes the same
path as in a real study: `StudyReport` passes it to `Mirror`, which writes it to MLflow in SQLite.
Only these two are measured, without the pictures and tables of the study's own run, whose updates
become rarer as the study grows.
"""

import io
import math
import tempfile
import threading
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

from rich.console import Console

from benchmarks.machine import write_result
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.searcher import BohbSearcher
from cluster.bohb.tune.trial import JOB, REPORT, TrialReport
from cluster.bohb.view import StudyViews
from cluster.session.terminal import Terminal
from cluster.storage.run_folder import RunStatus, locked_settings
from cluster.tracking import Mirror, Tracker
from tests.studies import MadeUpPool, new_study

GENERATIONS, BLOCK, BRACKETS = 2000, 100, 60


class MeasuredStudy:
    """A study with made-up scores, and the driver's CPU time at each generation."""

    def __init__(self, folder: Path) -> None:
        self.study = replace(new_study(folder), schedule=Schedule((2, 6, 18), 3))
        with locked_settings(folder, self.study.settings()) as identity:
            RunStatus("RUNNING", time.time(), BRACKETS).save(folder)
        journal = Journal(folder)
        search = BracketSearch.of(self.study, journal, BRACKETS)
        self.searcher = BohbSearcher(search, lambda: 1, math.inf)
        views = StudyViews(self.study, identity, live=True, journal=journal)
        tracker = Tracker(f"sqlite:///{folder}/mlflow.db", "CartPole-v0", folder / "artifacts")
        self.mirror = Mirror(tracker, views.view, print)
        self.mirror.mark(views.keys())
        terminal = Terminal(Console(file=io.StringIO()))
        self.report = StudyReport(
            BRACKETS, math.inf, journal, self.searcher, views, self.mirror, terminal
        )
        self.report.PICTURES_EVERY = math.inf
        self.callbacks = 0.0  # seconds
        self.seconds: list[float] = []  # until each generation

    def run_job(self, number: int) -> None:
        """Run one job, as Ray Tune would."""
        trial = SimpleNamespace(trial_id=str(number), last_result=None)
        suggested = self.searcher.suggest(trial.trial_id)
        assert isinstance(suggested, dict)
        job = suggested[JOB]
        self._call("on_trial_start", trial)
        runs = ConfigurationRuns.open(self.study, tuple(job["id"]), job["configuration"])
        reached = False
        while not reached:
            before, pool = runs.generations, MadeUpPool()
            state = runs.advance(pool)
            reached = runs.spent(job["budget"])
            record = state.records[-1] if runs.generations > before else None
            earlier = sum(run.generation for run in runs.states if run is not state)
            run = len(runs.states) - 1
            report = TrialReport(runs.tally, reached, record, run, earlier, runs.tally.cost)
            trial.last_result = {REPORT: report}
            self._call("on_trial_result", trial, trial.last_result)
            while self.mirror.waiting:  # a real generation takes longer than its tracking
                time.sleep(0.001)
            if record is not None:
                self.seconds.append(self._mirror_seconds() + self.callbacks)
        self.searcher.on_trial_complete(trial.trial_id, trial.last_result)
        self._call("on_trial_complete", trial)

    def _call(self, name: str, *arguments: object) -> None:
        started = time.thread_time()
        getattr(self.report, name)(0, [], *arguments)
        self.callbacks += time.thread_time() - started

    def _mirror_seconds(self) -> float:
        (thread,) = [thread for thread in threading.enumerate() if thread.name == "mirror"]
        assert thread.ident is not None
        return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))


def main() -> None:
    """Measure, print, and write `results/tracking.json`."""
    with tempfile.TemporaryDirectory() as folder:
        study = MeasuredStudy(Path(folder) / "CartPole-v0" / "study")
        jobs = 0
        while len(study.seconds) < GENERATIONS + BLOCK:  # the first block also imports libraries
            study.run_job(jobs)
            jobs += 1
            print(f"{jobs} jobs, {len(study.seconds)} generations", flush=True)
        study.mirror.close()
    ends = study.seconds[BLOCK - 1 : GENERATIONS + BLOCK : BLOCK]
    blocks = [round(last - first, 3) for first, last in pairwise(ends)]
    values = {
        "generations": GENERATIONS,
        "jobs": jobs,
        "warm_up_generations": BLOCK,
        "cpu_seconds_per_100_generations": blocks,
        "last_to_first": round(blocks[-1] / blocks[0], 3),
    }
    print(write_result("tracking", "python -m benchmarks.tracking", values))


if __name__ == "__main__":
    main()
