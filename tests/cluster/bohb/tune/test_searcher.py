"""The searcher, called as Ray Tune calls it."""

import math
import subprocess
import sys
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from bilevel.errors import StorageFailure
from bilevel.user_code import UserCodeError
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.objective import Tally
from cluster.bohb.study.journal import Journal
from cluster.bohb.tune.searcher import MAX_CRASHES, BohbSearcher
from cluster.bohb.tune.trial import JOB, REPORT, TrialReport
from tests.studies import new_study


def result(cost: float = 12.0, **values: Any) -> dict[str, Any]:
    """Last result of a trial with two confirmed SEs."""
    return {REPORT: TrialReport(Tally(cost, 2, 2, 0.0), **values)}


DONE = result(budget_reached=True)
MISTAKE = UserCodeError("agent 'mine': division by zero")


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal(tmp_path)


@pytest.fixture
def searcher(journal: Journal) -> BohbSearcher:
    search = BracketSearch(new_study(journal.folder), journal, 1)
    return BohbSearcher(search, lambda: 2, math.inf, Mock())


def suggested(searcher: BohbSearcher, trial_id: str) -> Any:
    job = searcher.suggest(trial_id)
    assert isinstance(job, dict)
    return job[JOB]


def test_the_number_of_concurrent_jobs_is_limited(searcher: BohbSearcher) -> None:
    suggested(searcher, "a")
    suggested(searcher, "b")
    assert searcher.suggest("c") is None
    searcher.on_trial_complete("a", DONE)
    suggested(searcher, "c")


def test_the_job_of_a_crashed_process_is_suggested_again_until_it_fails(
    searcher: BohbSearcher, journal: Journal
) -> None:
    first = suggested(searcher, "0")
    for number in range(1, MAX_CRASHES):
        searcher.on_trial_complete(str(number - 1), None, error=True)
        assert suggested(searcher, str(number)) == first
    assert journal.results == []
    searcher.on_trial_complete(str(MAX_CRASHES - 1), None, error=True)
    (line,) = journal.results
    assert line.loss is None
    assert line.exception == f"the trial's process died {MAX_CRASHES} times"
    assert suggested(searcher, "other") != first


@pytest.mark.parametrize(
    ("last", "message"),
    [
        ({REPORT: TrialReport(error=RuntimeError("Traceback\nValueError: no"))}, "ValueError: no"),
        (result(math.nan, budget_reached=True), "the objective is nan"),
        (result(math.inf, budget_reached=True), "the objective is inf"),
    ],
)
def test_a_job_without_a_finite_objective_fails(
    last: dict[str, Any], message: str, searcher: BohbSearcher, journal: Journal
) -> None:
    first = suggested(searcher, "a")
    searcher.on_trial_complete("a", last)
    (line,) = journal.results
    assert line.loss is None
    assert message in (line.exception or "")
    assert suggested(searcher, "b") != first


@pytest.mark.parametrize("last", [None, {}, result()])
def test_the_job_of_a_stopped_trial_is_suggested_again(
    last: dict[str, Any] | None, searcher: BohbSearcher, journal: Journal
) -> None:
    first = suggested(searcher, "a")
    searcher.on_trial_complete("a", last)
    assert journal.results == []
    assert suggested(searcher, "b") == first


@pytest.mark.parametrize("error", [MISTAKE, StorageFailure("cannot write '/x': disk full")])
def test_an_error_stops_the_study_without_a_result(
    error: Any, searcher: BohbSearcher, journal: Journal
) -> None:
    suggested(searcher, "a")
    searcher.on_trial_complete("a", {REPORT: TrialReport(error=error)})
    assert searcher.stopped_by is error
    assert journal.results == []
    assert searcher.suggest("b") == BohbSearcher.FINISHED


def test_a_mistake_after_a_success_is_a_failed_job(
    searcher: BohbSearcher, journal: Journal
) -> None:
    """The hyperparameters are the cause."""
    suggested(searcher, "a")
    searcher.on_trial_complete("a", DONE)
    suggested(searcher, "b")
    searcher.on_trial_complete("b", {REPORT: TrialReport(error=MISTAKE)})
    assert searcher.stopped_by is None
    assert [line.loss for line in journal.results] == [pytest.approx(6.0, rel=0.01), None]
    assert journal.results[0].info["confirmed"] == 2
    assert journal.results[1].exception == str(MISTAKE)


def test_a_full_disk_under_the_journal_stops_the_study(
    searcher: BohbSearcher, journal: Journal
) -> None:
    suggested(searcher, "a")
    (journal.folder / "results.json").symlink_to("/dev/full")
    searcher.on_trial_complete("a", DONE)
    assert isinstance(searcher.stopped_by, StorageFailure)
    assert journal.results == []


def test_a_trial_does_not_import_the_search() -> None:
    """hpbandster and ConfigSpace take longer to import than the trial itself."""
    heavy = "{'hpbandster', 'ConfigSpace'}"
    code = f"import sys, cluster.bohb.tune.trial; sys.exit(bool({heavy} & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", code], check=True)
