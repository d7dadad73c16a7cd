"""What the terminal tells while a study runs."""

import io
import math
import re
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from cluster.bohb.search.bracket_search import Job
from cluster.bohb.search.objective import Tally
from cluster.bohb.study.journal import Journal, Origin
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.trial import BUDGET_REACHED, MESSAGES, OBJECTIVE, RECORD, SPENT, TALLY
from cluster.bohb.view import StudyViews
from cluster.session.terminal import Terminal
from cluster.storage.run_folder import RunIdentity
from tests.studies import make_study


class Marks:
    """Stands for the mirror and the searcher, which the terminal does not show."""

    def __init__(self, job: Job) -> None:
        self.jobs = {"trial": job}

    def mark(self, keys: list[str]) -> None:
        """Nothing is shown in MLflow."""


@pytest.mark.parametrize(("budget", "told"), [(math.inf, ""), (900.0, r"; 1[45]m\d\ds left")])
def test_a_result_of_an_earlier_processs_generations(
    budget: float, told: str, tmp_path: Path
) -> None:
    """Nothing has been spent since the command began, so that no speed is known."""
    study = make_study(tmp_path)
    line = Journal(tmp_path).configs[0]
    job = Job(line.id, line.configuration, 3, Origin.RANDOM, 0.0)
    marks: Any = Marks(job)
    views = StudyViews(study, RunIdentity("0" * 32, 0.0), live=True)
    out = io.StringIO()
    terminal = Terminal(Console(file=out, width=200, soft_wrap=True))
    deadline = time.monotonic() + budget
    report = StudyReport(4, deadline, Journal(tmp_path), marks, views, marks, terminal)
    trial = SimpleNamespace(trial_id="trial", last_result=None)
    report.on_trial_start(0, [], trial)
    assert len(views.running) == 1
    result = {
        TALLY: Tally(cost=3.0, runs=1, confirmed=1, progress=0.0),
        MESSAGES: [],
        SPENT: 0.0,
        RECORD: None,
        OBJECTIVE: 3.0,
        BUDGET_REACHED: True,
    }
    report.on_trial_result(0, [], trial, result)
    trial.last_result = result
    report.on_trial_complete(0, [], trial)
    assert not views.running
    report.on_trial_start(1, [], trial)
    (shown,) = [text for text in out.getvalue().splitlines() if "objective 3" in text]
    assert re.search(rf"objective 3 \(best at \d+: \d+\){told}$", shown)
