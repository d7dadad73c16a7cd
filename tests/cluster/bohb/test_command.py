"""How a study uses a cluster and a time budget."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from cluster.bohb.command import StudyCommand, brackets_to_reach, deadlines
from cluster.bohb.study.journal import Journal
from cluster.bohb.study.profiles import PROFILES
from cluster.session.context import RunContext
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, Status
from tests.studies import make_study, new_study


@pytest.fixture
def command(tmp_path: Path) -> StudyCommand:
    """Two brackets, which start 3 and 2 configurations, without a number of workers."""
    context = RunContext(Home(tmp_path), "sqlite:///none.db")
    return StudyCommand(new_study(tmp_path), context, PROFILES["smoke"], workers_per_trial=0)


@pytest.mark.parametrize(
    ("cores", "workers", "trials"),
    [(1, 1, 1), (2, 1, 2), (5, 1, 5), (20, 4, 5), (10_000, 98, 102)],
)
def test_workers_per_trial_grow_with_the_cluster(
    command: StudyCommand, cores: int, workers: int, trials: int
) -> None:
    """Up to one for each evaluation of a generation."""
    nes = replace(command.study.base.nes, population_size=48, centre_agents=2)
    study = replace(command.study, base=replace(command.study.base, nes=nes))
    placed = replace(command, study=study).with_workers(cores)
    assert (placed.workers_per_trial, placed.trials_on(cores)) == (workers, trials)


@pytest.mark.parametrize(
    ("budget", "search", "end"),
    [(3660.0, 2700.0, 3600.0), (80.0, 30.0, 40.0), (None, math.inf, math.inf)],
)
def test_a_quarter_of_the_time_is_for_validation(
    budget: float | None, search: float, end: float
) -> None:
    """The rest of the budget, a minute or half of a short one, is for scoring the best SE."""
    assert deadlines(1000.0, budget) == (1000.0 + search, 1000.0 + end)


@pytest.mark.parametrize(
    ("requested", "status", "target", "brackets"),
    [
        (2, "FINISHED", 3, 5),
        (2, "FAILED", 3, 5),  # without an SE
        (2, "FAILED", 4, 4),
        (2, "KILLED", 3, 3),
        (5, "KILLED", 3, 5),
    ],
)
def test_a_complete_study_gets_more_brackets_and_an_unfinished_one_completes_its_own(
    requested: int, status: Status | None, target: int, brackets: int, tmp_path: Path
) -> None:
    study = make_study(tmp_path, brackets=3)
    run_status = None if status is None else RunStatus(status, 0.0, target)
    journal = Journal(tmp_path)
    assert brackets_to_reach(journal, study.schedule, requested, run_status) == brackets


def test_a_study_whose_time_was_over_completes_its_brackets(tmp_path: Path) -> None:
    study = make_study(tmp_path, brackets=3)
    journal, finished = Journal(tmp_path), RunStatus("FINISHED", 0.0, 3)
    journal.results.pop()
    assert brackets_to_reach(journal, study.schedule, 2, finished) == 3
    assert brackets_to_reach(journal, study.schedule, 4, finished) == 4
    assert brackets_to_reach(Journal(tmp_path / "new"), study.schedule, 2, None) == 2
