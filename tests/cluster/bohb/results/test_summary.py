import csv
import io
from dataclasses import replace
from pathlib import Path

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.results.tables import leaders_csv, results_csv
from cluster.bohb.search.validation import Validation
from cluster.bohb.study.brackets import Schedule, core_seconds_to_run
from cluster.bohb.study.journal import Journal
from tests.searches import LADDER, loss_of, new_search, run_to_end
from tests.studies import make_study


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_summary_of_a_whole_study(tmp_path: Path) -> None:
    jobs = run_to_end(new_search(tmp_path, brackets=4), fail=(1,))
    summary = StudySummary(Journal(tmp_path), LADDER.brackets(4))
    best = min((job for job in jobs if job.budget == 9), key=loss_of)
    assert summary.incumbent is not None
    assert summary.incumbent.id == best.id == summary.ranked[0]
    assert summary.configuration(best.id) == best.configuration
    points = summary.points()
    assert len(points) == len(jobs) - 1  # one failed
    assert points[-1].spent == core_seconds_to_run(LADDER.brackets(4))
    assert summary.core_seconds_left() == 0
    assert summary.bracket_table().count("\n") == 2 + len(LADDER.brackets(4))


def test_summary_without_results(tmp_path: Path) -> None:
    summary = StudySummary(Journal(tmp_path), Schedule((1, 3), 2).brackets(1))
    assert summary.incumbent is None
    assert summary.points() == []
    assert summary.ranked == []
    assert summary.core_seconds_left() == 3 + 2
    assert rows(results_csv(summary)) == rows(leaders_csv(summary)) == []


def test_the_winner_of_the_validation_is_the_incumbent(tmp_path: Path) -> None:
    journal = Journal(make_study(tmp_path).folder)
    before = StudySummary(journal)
    assert before.incumbent == before.leader is not None
    assert (before.validation_table(), before.validated_points()) == ("", [])
    second, first = (before.result_of(config_id) for config_id in before.ranked[:2])
    finalists = tuple(
        replace(line, budget=50, loss=loss) for line, loss in ((first, 1.0), (second, 2.0))
    )
    summary = StudySummary(journal, validation=Validation(len(journal.results), finalists))
    assert summary.incumbent == finalists[0]
    assert summary.leader == before.leader
    assert summary.validation_table().count("\n") == 2 + 2
    points = summary.validated_points()
    assert [point.objective for point in points] == [1.0, 2.0]
    assert {point.spent for point in points} == {sum(journal.reached.values()) + 100}
    assert [point.searched.objective for point in points] == [first.loss, second.loss]


def test_results_with_their_configurations_as_csv(tmp_path: Path) -> None:
    make_study(tmp_path, fail=(1,))
    journal = Journal(tmp_path)
    summary = StudySummary(journal)
    found = rows(results_csv(summary))
    assert len(found) == len(journal.results)
    for row, line in zip(found, journal.results, strict=True):
        config = journal.proposals[line.id]
        assert int(row["budget"]) == line.budget
        assert row["objective"] == ("" if line.loss is None else str(line.loss))
        assert row["origin"] == config.origin
        assert 0 <= float(row["started"]) <= float(row["finished"])
        assert all(row[name] == str(value) for name, value in config.configuration.items())
    assert [row["objective"] for row in found].count("") == 1
    assert summary.leader is not None
    assert rows(leaders_csv(summary))[-1]["objective"] == str(summary.leader.loss)
