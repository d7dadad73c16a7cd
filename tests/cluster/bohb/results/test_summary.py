import csv
import io
from dataclasses import replace
from pathlib import Path

import pytest

from bilevel.tasks import Task
from cluster.bohb.results.pictures import objective_against_cost
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.results.tables import brackets_csv, results_csv, validation_csv
from cluster.bohb.search.validation import Validation
from cluster.bohb.study.brackets import Schedule, core_seconds_to_run
from cluster.bohb.study.journal import Journal
from cluster.pictures import image
from tests.searches import LADDER, loss_of, new_search, run_to_end
from tests.studies import make_study


def test_summary_of_a_whole_study(tmp_path: Path) -> None:
    jobs = run_to_end(new_search(tmp_path, brackets=4), fail=(1,))
    summary = StudySummary(Journal(tmp_path), LADDER.brackets(4))
    best = min((job for job in jobs if job.budget == 9), key=loss_of)
    assert summary.incumbent is not None
    assert summary.incumbent.id == best.id == summary.ranked[0]
    points = summary.points()
    assert len(points) == len(jobs) - 1  # one failed
    assert points[-1][0] == core_seconds_to_run(LADDER.brackets(4))
    assert summary.core_seconds_left() == 0
    assert brackets_csv(summary).count("\n") == 1 + len(LADDER.brackets(4))


def test_summary_without_results(tmp_path: Path, cartpole: Task) -> None:
    summary = StudySummary(Journal(tmp_path), Schedule((1, 3), 2).brackets(1))
    assert summary.incumbent is None
    assert summary.points() == []
    assert summary.ranked == []
    assert summary.core_seconds_left() == 3 + 2
    assert results_csv(summary).strip() == ""
    assert image(objective_against_cost(summary, cartpole, "study"))


def test_the_winner_of_the_validation_is_the_incumbent(tmp_path: Path, cartpole: Task) -> None:
    journal = Journal(make_study(tmp_path).folder)
    before = StudySummary(journal)
    assert before.incumbent == before.leader is not None
    last = {line.id: line for line in journal.successes}
    finalists = tuple(
        replace(last[config_id], budget=50, loss=loss)
        for config_id, loss in zip(before.ranked[1::-1], (1.0, 2.0), strict=True)
    )
    summary = StudySummary(journal, validation=Validation(len(journal.results), finalists))
    assert summary.incumbent == finalists[0]
    assert summary.leader == before.leader
    assert validation_csv(summary).count("\n") == 1 + 2
    assert image(objective_against_cost(summary, cartpole, "study"))


@pytest.mark.parametrize("fail", [(), (1,)])
def test_results_with_their_configurations_as_csv(fail: tuple[int, ...], tmp_path: Path) -> None:
    make_study(tmp_path, fail=fail)
    journal = Journal(tmp_path)
    rows = list(csv.DictReader(io.StringIO(results_csv(StudySummary(journal)))))
    for row, line in zip(rows, journal.results, strict=True):
        config = journal.proposals[line.id]
        assert int(row["budget"]) == line.budget
        assert row["objective"] == ("" if line.loss is None else str(line.loss))
        assert row["origin"] == config.origin
        assert 0 <= float(row["started"]) <= float(row["finished"])
        assert all(row[name] == str(value) for name, value in config.configuration.items())
    assert [row["objective"] for row in rows].count("") == len(fail)
