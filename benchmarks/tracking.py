"""CPU time that tracking costs the driver as a study grows.

    python -m benchmarks.tracking

The study runs BOHB and NES, but scores are made up. The record of each generation takes the same
path as in a real study: `StudyReport` passes it to `Mirror`, which writes it to MLflow in SQLite.
Only these two are measured: first for each generation, then for each job, whose start and end
compare the files of its configuration with MLflow. The pictures and tables of the study's own run
are left out; their updates become rarer as the study grows.
"""

import io
import math
import statistics
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from benchmarks.machine import write_result
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.trial import TrialReport
from cluster.bohb.view import StudyViews
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, locked_settings
from cluster.tracking import Mirror, Point, Tracker
from tests.studies import MadeUpPool, new_study

GENERATIONS, BLOCK, BRACKETS = 2000, 100, 60


class MeasuredStudy:
    """A study with made-up scores, and the CPU seconds that tracking has cost."""

    def __init__(self, folder: Path) -> None:
        self.study = replace(new_study(folder), schedule=Schedule((2, 6, 18), 3))
        with locked_settings(folder, self.study.settings()):
            RunStatus("RUNNING", time.time(), BRACKETS).save(folder)
        journal = Journal(folder)
        self.search = BracketSearch(self.study, journal, BRACKETS)
        views = StudyViews(folder, live=True, journal=journal)
        tracker = Tracker(f"sqlite:///{folder}/mlflow.db", "CartPole-v0", Home(folder))
        self.mirror = Mirror(tracker, views.view, print)
        self.mirror.mark(views.keys())
        terminal = Terminal(Console(file=io.StringIO()))
        self.report = StudyReport(BRACKETS, math.inf, views, self.mirror, terminal)
        self.report.PICTURES_EVERY = math.inf
        self.generations: list[float] = []
        self.jobs: list[float] = []

    def run_job(self) -> None:
        """Run one job, as `BohbSearcher` and a trial would."""
        job = self.search.next_job()
        assert job is not None
        started = self._cost("started", job)
        runs = ConfigurationRuns(self.study, job.id, job.configuration).read()
        reached = False
        while not reached:
            before = runs.generations
            state = runs.advance(MadeUpPool())
            reached = runs.spent(job.budget)
            point = None
            if runs.generations > before:
                earlier = sum(run.generation for run in runs.states if run is not state)
                point = Point.of(state.records[-1], earlier, run=len(runs.states) - 1)
            report = TrialReport(runs.tally, reached, point)
            cost = self._cost("stepped", job, report)
            if point is not None:
                self.generations.append(cost)
        self.search.register(job, runs.tally.objective, runs.tally.info)
        self.jobs.append(started + self._cost("ended", job, report))

    def _cost(self, method: str, *arguments: object) -> float:
        """Call the report, wait for the mirror, and return the CPU seconds of both."""
        mirror, main = self._mirror_seconds(), time.thread_time()
        getattr(self.report, method)(*arguments)
        spent = time.thread_time() - main
        while self.mirror.waiting:
            time.sleep(0.001)
        return spent + self._mirror_seconds() - mirror

    def _mirror_seconds(self) -> float:
        (thread,) = [thread for thread in threading.enumerate() if thread.name == "mirror"]
        assert thread.ident is not None
        return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))


def main() -> None:
    """Measure, print, and write `results/tracking.json`."""
    with tempfile.TemporaryDirectory() as folder:
        study = MeasuredStudy(Path(folder) / "CartPole-v0" / "study")
        while len(study.generations) < GENERATIONS:
            study.run_job()
            print(f"{len(study.jobs)} jobs, {len(study.generations)} generations", flush=True)
        study.mirror.close()
    blocks = [sum(study.generations[i : i + BLOCK]) for i in range(0, GENERATIONS, BLOCK)]
    tenth = len(study.jobs) // 10
    values = {
        "generations": GENERATIONS,
        "cpu_seconds_per_100_generations": [round(block, 3) for block in blocks],
        "last_100_to_first_100": round(blocks[-1] / blocks[0], 2),
        "jobs": len(study.jobs),
        "cpu_seconds_per_job": {
            "first tenth": round(statistics.median(study.jobs[1 : tenth + 1]), 3),
            "last tenth": round(statistics.median(study.jobs[-tenth:]), 3),
        },
    }
    print(write_result("tracking", "python -m benchmarks.tracking", values))


if __name__ == "__main__":
    main()
