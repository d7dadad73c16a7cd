"""The report of a study."""

import io
import math
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mlflow
import pytest
from rich.console import Console

from bilevel.nes import GenerationRecord
from cluster.bohb.search.bracket_search import Job
from cluster.bohb.search.objective import Tally
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import Journal, Origin
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.trial import TrialReport
from cluster.bohb.view import StudyViews
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus
from cluster.tracking import Mirror, Point, RunView, Tracker
from cluster.tracking.tracker import KEY
from tests.studies import make_study

_DRAWN = Origin.RANDOM, 0.0
TALLY = Tally(cost=3.0, runs=1, confirmed=1, progress=0.0)


class Trial:
    """A trial of a job with generations on disk, whose reports go to MLflow and a terminal."""

    def __init__(self, folder: Path, time_budget: float = math.inf) -> None:
        self.study = make_study(folder)
        self.journal = Journal(folder)
        self.records: list[GenerationRecord] = []
        for line in self.journal.configs:
            states = ConfigurationRuns(self.study, line.id, line.configuration).read().states
            if records := [record for state in states for record in state.records]:
                self.records, self.job = records, Job(line.id, line.configuration, 3, *_DRAWN)
        RunStatus("RUNNING", 0.0, 2).save(folder)
        self.views = StudyViews(folder, live=True, journal=self.journal)
        self.key = self.views.key(configuration_name(self.job.id))
        self.tracker = Tracker(f"sqlite:///{folder}/mlflow.db", "task", Home(folder))
        self.out = io.StringIO()
        self.built: list[str] = []
        terminal = Terminal(Console(file=self.out, width=200, soft_wrap=True))
        self.mirror = Mirror(self.tracker, self._view, terminal.log)
        deadline = time.monotonic() + time_budget
        self.report = StudyReport(4, deadline, self.views, self.mirror, terminal)

    def _view(self, key: str) -> RunView:
        self.built.append(key)
        return self.views.view(key)

    def start(self) -> None:
        """Start the trial, with the study's run in MLflow."""
        self.mirror.mark([self.views.parent])
        self.report.started(self.job)

    def history(self, name: str) -> dict[int, float]:
        """A metric of the configuration by step."""
        client = mlflow.MlflowClient(self.tracker.uri)
        (run,) = client.search_runs([self.tracker.experiment_id], f"tags.`{KEY}` = '{self.key}'")
        return {m.step: m.value for m in client.get_metric_history(run.info.run_id, name)}


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_generation_costs_as_much_however_many_there_were(tmp_path: Path) -> None:
    """No files are read for it: only its own point is written."""
    trial = Trial(tmp_path)
    trial.start()
    wait_for(lambda: not trial.mirror.waiting)
    template, before = trial.records[-1], len(trial.records)
    for number in range(50):
        record = replace(template, generation=number, finished=template.finished + 1 + number)
        trial.report.stepped(trial.job, TrialReport(TALLY, False, Point.of(record, before, run=9)))
        if number % 10 == 0:  # otherwise the mirror would write all of them at once
            wait_for(lambda: not trial.mirror.waiting)
    assert trial.mirror.close() == 0
    assert trial.built == [trial.views.parent, trial.key]
    assert sorted(trial.history("score_mean")) == list(range(before + 50))
    assert trial.history("run")[before + 49] == 9


@pytest.mark.parametrize("time_budget", [math.inf, 900.0])
def test_a_result_is_logged_with_the_best_one(time_budget: float, tmp_path: Path) -> None:
    trial = Trial(tmp_path, time_budget)
    trial.start()
    assert trial.views.running
    trial.report.ended(trial.job, TrialReport(TALLY, budget_reached=True))
    assert not trial.views.running
    assert trial.mirror.close() == 0
    (line,) = [text for text in trial.out.getvalue().splitlines() if "objective 3" in text]
    assert re.search(r"objective 3 \(best at \d+: \d+\)$", line)
