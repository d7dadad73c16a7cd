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

from cluster.bohb.journal import Journal, Origin
from cluster.bohb.objective import Tally
from cluster.bohb.search import Job
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.trial import BUDGET_REACHED, MESSAGES, OBJECTIVE, SPENT, TALLY
from cluster.session.terminal import Terminal
from tests.studies import make_study


class Marks:
    """Stands for the mirror, the views and the searcher, which the terminal does not show."""

    parent = "study"

    def __init__(self, job: Job) -> None:
        self.jobs = {"trial": job}

    def mark(self, keys: list[str]) -> None:
        """Nothing is shown in MLflow."""

    def key(self, name: str) -> str:
        """The name will do."""
        return name


@pytest.mark.parametrize(("budget", "told"), [(math.inf, ""), (900.0, r"; 1[45]m\d\ds left")])
def test_a_result_of_an_earlier_processs_generations(
    budget: float, told: str, tmp_path: Path
) -> None:
    """Nothing has been spent since the command began, so that no speed is known."""
    study = make_study(tmp_path)
    line = Journal(tmp_path).configs[0]
    job = Job(line.id, line.configuration, 3, Origin.RANDOM, 0.0)
    marks: Any = Marks(job)
    out = io.StringIO()
    terminal = Terminal(Console(file=out, width=200, soft_wrap=True))
    deadline = time.monotonic() + budget
    report = StudyReport(
        study, 4, deadline, Journal(tmp_path), marks, marks, set(), marks, terminal
    )
    trial = SimpleNamespace(trial_id="trial", last_result=None)
    report.on_trial_start(0, [], trial)
    result = {
        TALLY: Tally(cost=3.0, runs=1, confirmed=1, progress=0.0),
        MESSAGES: [],
        SPENT: 0.0,
        "record": None,
        OBJECTIVE: 3.0,
        BUDGET_REACHED: True,
    }
    report.on_trial_result(0, [], trial, result)
    trial.last_result = result
    report.on_trial_complete(0, [], trial)
    report.on_trial_start(1, [], trial)
    (shown,) = [text for text in out.getvalue().splitlines() if "objective 3" in text]
    assert re.search(rf"objective 3 \(best at \d+: \d+\){told}$", shown)
