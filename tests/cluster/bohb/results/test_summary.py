from pathlib import Path

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.brackets import Schedule, core_seconds_to_run
from cluster.bohb.study.journal import Journal
from tests.searches import LADDER, loss_of, new_search, run_to_end


def test_of_a_whole_study(tmp_path: Path) -> None:
    jobs = run_to_end(new_search(tmp_path, brackets=4), fail=(1,))
    journal = Journal(tmp_path)
    summary = StudySummary(journal, LADDER.brackets(4))
    best = min((job for job in jobs if job.budget == 9), key=loss_of)
    assert summary.incumbent is not None
    assert summary.incumbent.id == best.id
    assert summary.configuration(best.id) == best.configuration
    points = summary.points()
    assert len(points) == len(jobs) - 1  # one failed
    assert points[-1].spent == core_seconds_to_run(LADDER.brackets(4))
    assert summary.core_seconds_left() == 0
    assert summary.bracket_table().count("\n") == 2 + len(LADDER.brackets(4))


def test_of_nothing(tmp_path: Path) -> None:
    summary = StudySummary(Journal(tmp_path), Schedule((1, 3), 2).brackets(1))
    assert summary.incumbent is None
    assert summary.points() == []
    assert summary.core_seconds_left() == 3 + 2
