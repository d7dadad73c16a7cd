"""The searcher, called as Ray Tune calls it."""

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from bilevel.errors import StorageFailure
from bilevel.user_code import Mistake
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.objective import Tally
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal
from cluster.bohb.tune.searcher import DEATHS, BohbSearcher
from cluster.bohb.tune.trial import (
    BUDGET_REACHED,
    FAILURE,
    JOB,
    MISTAKE,
    NO_STORAGE,
    OBJECTIVE,
    TALLY,
)
from search_spaces.bohb import search_space

#: The report of a trial that has spent its budget.
DONE = {OBJECTIVE: 6.0, TALLY: Tally(12.0, 2, 2, 0.0), BUDGET_REACHED: True}


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal(tmp_path)


@pytest.fixture
def searcher(journal: Journal) -> BohbSearcher:
    search = BracketSearch(search_space("core"), Schedule((1, 3), 2), 1, 0, journal)
    return BohbSearcher(search, lambda: 2, math.inf)


def suggested(searcher: BohbSearcher, trial_id: str) -> Any:
    job = searcher.suggest(trial_id)
    assert isinstance(job, dict)
    return job[JOB]


def test_as_many_jobs_at_a_time_as_the_cluster_has_room_for(searcher: BohbSearcher) -> None:
    suggested(searcher, "a")
    suggested(searcher, "b")
    assert searcher.suggest("c") is None
    searcher.on_trial_complete("a", DONE)
    suggested(searcher, "c")


def test_a_job_whose_process_died_is_the_next_one_again(
    searcher: BohbSearcher, journal: Journal
) -> None:
    first = suggested(searcher, "a")
    for number in range(DEATHS - 1):
        searcher.on_trial_complete("a" if number == 0 else str(number), None, error=True)
        assert suggested(searcher, str(number + 1)) == first
    assert journal.results == []
    searcher.on_trial_complete(str(DEATHS - 1), None, error=True)
    (line,) = journal.results
    assert line.loss is None
    assert line.exception == f"the trial's process died {DEATHS} times"
    assert suggested(searcher, "other") != first


@pytest.mark.parametrize(
    ("result", "told"),
    [
        ({FAILURE: "Traceback\nValueError: no"}, "ValueError: no"),
        ({OBJECTIVE: math.nan, BUDGET_REACHED: True}, "the objective is nan"),
        ({OBJECTIVE: math.inf, BUDGET_REACHED: True}, "the objective is inf"),
    ],
)
def test_what_is_no_result_counts_as_failed(
    result: dict[str, Any], told: str, searcher: BohbSearcher, journal: Journal
) -> None:
    suggested(searcher, "a")
    searcher.on_trial_complete("a", result)
    (line,) = journal.results
    assert line.loss is None
    assert told in (line.exception or "")


def test_a_users_wrong_agent_stops_the_study(searcher: BohbSearcher, journal: Journal) -> None:
    suggested(searcher, "a")
    searcher.on_trial_complete("a", {MISTAKE: "agent 'mine': division by zero"})
    assert isinstance(searcher.stopped_by, Mistake)
    assert journal.results == []


def test_an_agent_that_has_worked_fails_with_its_hyperparameters(
    searcher: BohbSearcher, journal: Journal
) -> None:
    suggested(searcher, "a")
    searcher.on_trial_complete("a", DONE)
    suggested(searcher, "b")
    searcher.on_trial_complete("b", {MISTAKE: "agent 'mine': division by zero"})
    assert searcher.stopped_by is None
    assert [result.loss for result in journal.results] == [6.0, None]
    assert journal.results[0].info["confirmed"] == 2
    assert journal.results[1].exception == "agent 'mine': division by zero"


def test_a_job_that_was_stopped_short_counts_as_nothing(
    searcher: BohbSearcher, journal: Journal
) -> None:
    first = suggested(searcher, "a")
    searcher.on_trial_complete("a", {OBJECTIVE: 1.0, BUDGET_REACHED: False})
    assert journal.results == []
    assert suggested(searcher, "b") == first


def test_no_room_stops_the_study_and_the_job_counts_as_nothing(
    searcher: BohbSearcher, journal: Journal
) -> None:
    suggested(searcher, "a")
    searcher.on_trial_complete("a", {NO_STORAGE: "cannot write '/x': No space left on device"})
    assert isinstance(searcher.stopped_by, StorageFailure)
    assert journal.results == []
    assert searcher.suggest("b") == BohbSearcher.FINISHED


def test_a_journal_that_cannot_be_written_stops_the_study(
    searcher: BohbSearcher, journal: Journal
) -> None:
    """Its file is a link to a device that is always full."""
    suggested(searcher, "a")
    journal.paths[1].symlink_to("/dev/full")
    searcher.on_trial_complete("a", DONE)
    assert isinstance(searcher.stopped_by, StorageFailure)
    assert journal.results == []


def test_a_trial_starts_without_what_proposes() -> None:
    """The imports of hpbandster and ConfigSpace take longer than a trial's own."""
    proposing = "{'hpbandster', 'ConfigSpace'}"
    code = f"import sys, cluster.bohb.tune.trial; sys.exit(bool({proposing} & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", code], check=True)
